//! [`Trials`]: packages of a source at some precisions, and their errors in pictures.

use std::collections::BTreeMap;
use std::num::NonZero;

use codec::{Clip, Coder, EncodeOptions, Limits, Precision, Source, decode_parallel, encode_parallel};

use super::{CodeError, SMALL_ROWS};
use crate::prune::{Fidelity, PictureErrors, Pictures};
use crate::reference::RenderScene;

/// Packages of a source, each made once, and their errors, each computed once.
#[derive(Debug)]
pub(super) struct Trials<'a> {
    source: &'a Source<'a>,
    layers: &'a [usize],
    /// All but [`Precision::psnr`].
    precision: Precision,
    pub(super) judge: &'a Pictures,
    /// By the bits of the precision in dB.
    known: BTreeMap<u64, Trial>,
    /// Latest squared error in each picture, times that of the precision: about the same for each trial. Infinite
    /// before the first.
    errors: Vec<f64>,
}

/// A package at one precision.
#[derive(Debug)]
struct Trial {
    bytes: Vec<u8>,
    /// Errors in each picture; `None` if not rendered.
    errors: Vec<Option<PictureErrors>>,
}

impl<'a> Trials<'a> {
    pub(super) fn new(
        source: &'a Source<'a>,
        layers: &'a [usize],
        precision: Precision,
        judge: &'a Pictures,
    ) -> Trials<'a> {
        let errors = vec![f64::INFINITY; judge.len()];
        Trials { source, layers, precision, judge, known: BTreeMap::new(), errors }
    }

    /// Whether the PSNR of a package may jump between neighbouring precisions.
    pub(super) fn is_small(&self) -> bool {
        self.source.field.len() <= SMALL_ROWS
    }

    /// Packages the source at a precision in dB.
    pub(super) fn encode(&self, finer_db: f64) -> Result<Vec<u8>, CodeError> {
        let precision = Precision { psnr: finer_db, ..self.precision.clone() };
        let options = EncodeOptions { coder: Coder::Context, layers: self.layers.to_vec(), precision };
        encode_parallel(self.source, &options, threads()).map_err(CodeError::Encode)
    }

    /// The package at a precision in dB.
    pub(super) fn bytes(&mut self, finer_db: f64) -> Result<&[u8], CodeError> {
        if !self.known.contains_key(&finer_db.to_bits()) {
            let trial = Trial { bytes: self.encode(finer_db)?, errors: vec![None; self.judge.len()] };
            self.known.insert(finer_db.to_bits(), trial);
        }
        Ok(&self.known[&finer_db.to_bits()].bytes)
    }

    /// The fidelity at a precision in dB, if it is at least `least_db`: over all pictures, and in each. Renders
    /// the pictures with the largest errors first.
    pub(super) fn meets(
        &mut self,
        finer_db: f64,
        least_db: (f64, f64),
    ) -> Result<Option<Fidelity>, CodeError> {
        let clip = decode(self.bytes(finer_db)?)?;
        let mut order: Vec<usize> = (0..self.judge.len()).collect();
        order.sort_by(|&a, &b| self.errors[b].total_cmp(&self.errors[a]));
        let trial = self.known.get_mut(&finer_db.to_bits()).expect("it was just made");
        let scene = RenderScene::from(&clip);
        let fidelity = self.judge.compare_at_least(&scene, least_db, &order, &mut trial.errors);
        for (latest, errors) in self.errors.iter_mut().zip(&trial.errors) {
            if let Some(errors) = errors {
                *latest = errors.squared * libm::exp10(0.1 * finer_db);
            }
        }
        Ok(fidelity)
    }
}

/// Decodes a package.
pub(super) fn decode(bytes: &[u8]) -> Result<Clip, CodeError> {
    decode_parallel(bytes, &Limits::default(), threads()).map_err(CodeError::Decode)
}

fn threads() -> NonZero<usize> {
    NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN)
}

#[cfg(test)]
mod tests {
    use super::super::TargetCoder;
    use super::*;
    use crate::prune::scenes::cloud;
    use crate::prune::{dome, posed_views};
    use crate::reference::sensitivities;
    use codec::ClipInfo;

    #[test]
    fn a_later_target_gets_the_same_package_with_fewer_trials() {
        let field = cloud(1, 60);
        let info = ClipInfo {
            duration_s: 1.0,
            fps: 30.0,
            up: [0.0, 1.0, 0.0],
            metres_per_unit: 1.0,
            viewpoints: Vec::new(),
        };
        let source = Source { info: &info, field: &field, plate: None };
        let cameras = dome(&field, &[0.5], info.up, 0.0, (32, 24));
        let views = posed_views(&cameras, &[0.5]);
        let known = sensitivities(&field, None, &views, || ());
        let judge = Pictures::take(&RenderScene::from(&field), views, || ());
        let coder = || TargetCoder::new(&source, &[], known.clone(), &judge);
        let [mut alone, mut after] = [coder(), coder()];
        let first = after.code(40.0, || ()).unwrap();
        let before = after.own.known.len();
        let [expected, second] = [&mut alone, &mut after].map(|coder| coder.code(45.0, || ()).unwrap());
        assert!(expected.bytes == second.bytes && expected.fidelity == second.fidelity);
        assert!(first.bytes.len() < second.bytes.len() && second.miss.is_none(), "{:?}", second.miss);
        let (fresh, added) = (alone.own.known.len(), after.own.known.len() - before);
        assert!(added < fresh, "{added} trials of {fresh}");
    }
}
