//! [`Trials`]: packages of a source at some precisions, and their errors in pictures.

use std::collections::BTreeMap;
use std::num::NonZero;

use codec::{Clip, Coder, EncodeOptions, Limits, Precision, Source, decode_parallel, encode_parallel};

use super::error::CodeError;
use crate::prune::{Fidelity, PictureErrors, Pictures};
use crate::reference::RenderScene;

/// Rows of a small field at most. In small and regular fields, many Gaussians have the same numbers and so the
/// same errors: the PSNR jumps by up to 10 dB between neighbouring precisions, and equal precision for all
/// rows can be smaller. In large fields it was not in any case measured.
const SMALL_ROWS: usize = 16_384;

/// Packages of a source, each made once, and their errors, each computed once.
#[derive(Debug)]
pub(super) struct Trials<'a> {
    pub(super) source: &'a Source<'a>,
    pub(super) layers: &'a [usize],
    pub(super) by_device: bool,
    /// All but [`Precision::psnr`].
    precision: Precision,
    pub(super) judge: &'a Pictures,
    /// By the bits of the precision in dB.
    pub(super) known: BTreeMap<u64, Trial>,
    /// Latest squared error in each picture, times the squared error of the precision: about the same for each trial.
    /// Infinite before the first.
    errors: Vec<f64>,
}

/// A package at one precision.
#[derive(Debug)]
pub(super) struct Trial {
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
        Trials { source, layers, by_device: false, precision, judge, known: BTreeMap::new(), errors }
    }

    /// Whether the PSNR of a package may jump between neighbouring precisions.
    pub(super) fn is_small(&self) -> bool {
        self.source.field.len() <= SMALL_ROWS
    }

    /// The precision of all rows for one in dB.
    pub(super) fn at(&self, finer_db: f64) -> Precision {
        Precision { psnr: finer_db, ..self.precision.clone() }
    }

    /// The options of a package at a precision.
    pub(super) fn options(&self, precision: Precision) -> EncodeOptions {
        EncodeOptions {
            coder: Coder::Rans,
            layers: self.layers.to_vec(),
            precision,
            by_device: self.by_device,
        }
    }

    /// Packages the source at a precision in dB.
    pub(super) fn encode(&self, finer_db: f64) -> Result<Vec<u8>, CodeError> {
        let options = self.options(self.at(finer_db));
        encode_parallel(self.source, &options, threads()).map_err(CodeError::Encode)
    }

    /// Decodes a package and compares it with the source.
    pub(super) fn compare(&self, bytes: &[u8]) -> Result<(Clip, Fidelity), CodeError> {
        let clip = decode(bytes)?;
        let fidelity = self.judge.compare(&RenderScene::from(&clip), || ());
        Ok((clip, fidelity))
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
