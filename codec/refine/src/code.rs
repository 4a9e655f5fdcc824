//! [`code`]: packages a field with a target PSNR.
//!
//! The sensitivity of each Gaussian in pictures sets its precision. The package is decoded, rendered and
//! compared with the field, and encoded again with a corrected precision until it meets the target.

use std::num::NonZero;

use codec::{
    Clip, Coder, EncodeError, EncodeOptions, Error, Limits, Precision, Sensitivity, Source, decode_parallel,
    encode_parallel,
};

use crate::prune::{Pictures, PosedView};
use crate::reference::{RenderScene, sensitivities};

/// Most packages that [`code`] encodes.
pub const TRIALS: usize = 5;

/// Accepted excess over the target PSNR, in dB.
const TOLERANCE: f64 = 0.1;

/// A package with its decoded clip and quality.
#[derive(Clone, Debug)]
pub struct Coded {
    /// Bytes of the package.
    pub bytes: Vec<u8>,
    /// The decoded package.
    pub clip: Clip,
    /// PSNR in dB of pictures of the clip against pictures of the field.
    pub psnr_db: f64,
}

/// Error of [`code`].
#[derive(Debug)]
pub enum CodeError {
    /// The field cannot be packaged.
    Encode(EncodeError),
    /// The package cannot be decoded.
    Decode(Error),
}

/// Packages `source` with the coder `context` at a PSNR of `psnr_db` or slightly above, or as close as
/// possible. `layers` are the layer ends in rows. Sensitivities are taken from the views `seen`; `judge`
/// holds pictures of the source to compare with. `on_step` is called after each of `seen` and each of
/// [`TRIALS`].
///
/// # Errors
/// Errors of [`codec::encode`] and [`codec::decode`].
pub fn code(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    seen: &[PosedView],
    judge: &Pictures,
    mut on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let known = sensitivities(source.field, source.plate, seen, &mut on_step);
    code_knowing(source, layers, psnr_db, known, judge, on_step)
}

/// Packages `source` as [`code`] does with known sensitivities and footprint, as computed by
/// [`sensitivities`]. `on_step` is called after each of [`TRIALS`].
///
/// # Errors
/// Errors of [`codec::encode`] and [`codec::decode`].
pub fn code_knowing(
    source: &Source,
    layers: &[usize],
    psnr_db: f64,
    sensitivities: Option<(Vec<Sensitivity>, f32)>,
    judge: &Pictures,
    mut on_step: impl FnMut(),
) -> Result<Coded, CodeError> {
    let mut precision = Precision { psnr: psnr_db, ..Precision::default() };
    if let Some((rows, footprint)) = sensitivities {
        precision.sensitivities = rows;
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
        // The pictures are equal, or the target is met.
        if !surplus.is_finite() || (0.0..TOLERANCE).contains(&surplus) {
            (trial + 1..TRIALS).for_each(|_| on_step());
            break;
        }
        precision.psnr -= surplus - 0.5 * TOLERANCE;
    }
    Ok(best.expect("TRIALS is above 0"))
}
