//! [`code`]: a field to a package just as exact as asked for.
//!
//! Pictures tell how visible every Gaussian is; the package is made with that, decoded, rendered
//! and compared with the field, and made again with the precision corrected.

use std::num::NonZero;

use codec::{
    Clip, Coder, EncodeError, EncodeOptions, Error, Limits, Precision, Sensitivity, Source, decode_parallel,
    encode_parallel,
};

use crate::prune::{Pictures, PosedView};
use crate::reference::{RenderScene, sensitivities};

/// Most packages that are made to find one.
pub const TRIALS: usize = 5;

/// How much more exact than asked for a package may be, in dB.
const TOLERANCE: f64 = 0.1;

/// A package, what it decodes to, and how far that is from the field.
#[derive(Clone, Debug)]
pub struct Coded {
    /// The package.
    pub bytes: Vec<u8>,
    /// The package, decoded.
    pub clip: Clip,
    /// PSNR in dB of its pictures against those of the field.
    pub psnr_db: f64,
}

/// Why there is no package.
#[derive(Debug)]
pub enum CodeError {
    /// The field cannot be packaged.
    Encode(EncodeError),
    /// The package cannot be read.
    Decode(Error),
}

/// Packages `source` with the coder `context`, no less exact than `psnr_db` where that can be
/// reached, and little more. `seen` are pictures that show what matters, `judge` holds pictures of
/// the source to compare with. `on_step` is called after each of `seen` and each of [`TRIALS`].
///
/// # Errors
/// Those of [`codec::encode`] and [`codec::decode`].
pub fn code(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    seen: &[PosedView],
    judge: &Pictures,
    mut on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let visible = sensitivities(source.field, source.plate, seen, &mut on_step);
    code_knowing(source, layers, psnr_db, visible, judge, on_step)
}

/// Packages `source` as [`code`] does where what matters is known: the sensitivities of its rows and
/// the blur that they were seen with, as [`sensitivities`] finds them. `on_step` is called after
/// each of [`TRIALS`].
///
/// # Errors
/// Those of [`codec::encode`] and [`codec::decode`].
pub fn code_knowing(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    visible: Option<(Vec<Sensitivity>, f32)>,
    judge: &Pictures,
    mut on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let mut precision = Precision { psnr: psnr_db, ..Precision::default() };
    if let Some((sensitivities, footprint)) = visible {
        precision.sensitivities = sensitivities;
        precision.footprint = Some(footprint);
    }
    let threads = NonZero::new(rayon::current_num_threads()).unwrap_or(NonZero::<usize>::MIN);
    let mut best: Option<Coded> = None;
    for trial in 0..TRIALS {
        let options =
            EncodeOptions { coder: Coder::Context, layers: layers.to_vec(), precision: precision.clone() };
        let bytes = encode_parallel(source, &options, threads).map_err(CodeError::Encode)?;
        let clip = decode_parallel(&bytes, &Limits::default(), threads).map_err(CodeError::Decode)?;
        let coded_db = judge.psnr(&RenderScene::from(&clip), || ());
        on_step();
        let coded = Coded { bytes, clip, psnr_db: coded_db };
        let is_better =
            best.as_ref().is_none_or(|best| match (best.psnr_db >= psnr_db, coded_db >= psnr_db) {
                (true, true) => coded.bytes.len() < best.bytes.len(),
                (false, false) => coded_db > best.psnr_db,
                (_, reached) => reached,
            });
        if is_better {
            best = Some(coded);
        }
        let surplus = coded_db - psnr_db;
        // Nothing to see, or nothing to gain.
        if !surplus.is_finite() || (0.0..TOLERANCE).contains(&surplus) {
            (trial + 1..TRIALS).for_each(|_| on_step());
            break;
        }
        precision.psnr -= surplus - 0.5 * TOLERANCE;
    }
    Ok(best.expect("there is a first trial"))
}
