//! [`Trials`]: packages of a source at some precisions, and their errors in pictures.

use std::collections::BTreeMap;
use std::f32::consts::FRAC_1_SQRT_2;
use std::num::NonZero;

use codec::{Clip, Coder, EncodeOptions, Limits, Precision, Source, decode_parallel, encode_parallel};

use super::error::CodeError;
use crate::prune::{Fidelity, PictureErrors, Pictures};
use crate::reference::RenderScene;

/// Rows of a small field at most. In small and regular fields, many Gaussians have the same numbers and so the
/// same errors: the PSNR jumps by up to 10 dB between neighbouring precisions, and equal precision for all
/// rows can be smaller. In large fields it was not in any case measured.
const SMALL_ROWS: usize = 16_384;

/// How finely a package is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fineness {
    /// The precision, see [`Precision::psnr`].
    pub(super) finer_db: f64,
    /// Share of the rows, the last ones, that have steps a half octave coarser.
    pub(super) coarser_share: f64,
}

impl Fineness {
    /// The same precision for all rows.
    pub(super) fn even(finer_db: f64) -> Fineness {
        Fineness { finer_db, coarser_share: 0.0 }
    }

    fn key(self) -> [u64; 2] {
        [self.finer_db, self.coarser_share].map(f64::to_bits)
    }
}

/// Packages of a source, each made once, and their errors, each computed once.
#[derive(Debug)]
pub(super) struct Trials<'a> {
    pub(super) source: &'a Source<'a>,
    pub(super) layers: &'a [usize],
    pub(super) by_device: bool,
    /// All but [`Precision::psnr`].
    precision: Precision,
    pub(super) judge: &'a Pictures,
    /// By the bits of the fineness.
    pub(super) known: BTreeMap<[u64; 2], Trial>,
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

    /// The precision of all rows.
    pub(super) fn at(&self, fineness: Fineness) -> Precision {
        let mut precision = Precision { psnr: fineness.finer_db, ..self.precision.clone() };
        let rows = &mut precision.sensitivities;
        let coarser = (fineness.coarser_share * rows.len() as f64).round() as usize;
        for row in rows.iter_mut().rev().take(coarser) {
            row.color *= FRAC_1_SQRT_2;
            row.geometry *= FRAC_1_SQRT_2;
        }
        precision
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

    /// Packages the source.
    pub(super) fn encode(&self, fineness: Fineness) -> Result<Vec<u8>, CodeError> {
        let options = self.options(self.at(fineness));
        encode_parallel(self.source, &options, threads()).map_err(CodeError::Encode)
    }

    /// Decodes a package and compares it with the source.
    pub(super) fn compare(&self, bytes: &[u8]) -> Result<(Clip, Fidelity), CodeError> {
        let clip = decode(bytes)?;
        let fidelity = self.judge.compare(&RenderScene::from(&clip), || ());
        Ok((clip, fidelity))
    }

    /// The package of a fineness.
    pub(super) fn bytes(&mut self, fineness: Fineness) -> Result<&[u8], CodeError> {
        let key = fineness.key();
        if !self.known.contains_key(&key) {
            let trial = Trial { bytes: self.encode(fineness)?, errors: vec![None; self.judge.len()] };
            self.known.insert(key, trial);
        }
        Ok(&self.known[&key].bytes)
    }

    /// The fidelity of a fineness, if it is at least `least_db`: over all pictures, and in each. Renders
    /// the pictures with the largest errors first.
    pub(super) fn meets(
        &mut self,
        fineness: Fineness,
        least_db: (f64, f64),
    ) -> Result<Option<Fidelity>, CodeError> {
        let clip = decode(self.bytes(fineness)?)?;
        let mut order: Vec<usize> = (0..self.judge.len()).collect();
        order.sort_by(|&a, &b| self.errors[b].total_cmp(&self.errors[a]));
        let trial = self.known.get_mut(&fineness.key()).expect("it was just made");
        let scene = RenderScene::from(&clip);
        let fidelity = self.judge.compare_at_least(&scene, least_db, &order, &mut trial.errors);
        for (latest, errors) in self.errors.iter_mut().zip(&trial.errors) {
            if let Some(errors) = errors {
                *latest = errors.squared * libm::exp10(0.1 * fineness.finer_db);
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
