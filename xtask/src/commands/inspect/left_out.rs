//! What a package does without, and what that saves.
//!
//! Saved bytes of the package are those of the coder's columns before entropy coding; saved bytes
//! of the GPU are those of the player's records.

use codec::{Clip, Contents, MOTION_ORDER_MAX, SH_DEGREE_MAX};
use serde::Serialize;
use shaders::{Motion, layout, sh_words};

/// Bits of a Gaussian's window centre and width in the chunks of the coder `fixed` (FORMAT.md).
/// The ranges at the start of a chunk, 4 bytes a part, are not counted here and below.
const WINDOW_BITS: usize = 2 * 16;

/// Bits of its motion coefficients of one power.
const MOTION_POWER_BITS: usize = 3 * 10;

/// Bits of its rotation rates.
const ROTATION_RATES_BITS: usize = 4 * 8;

/// Bits of its coefficients of one spherical harmonic.
const SH_FUNCTION_BITS: usize = 3 * 8;

/// An optional part that is absent from some Gaussians.
#[derive(Serialize)]
pub(super) struct LeftOut {
    pub(super) part: String,
    /// Gaussians without it.
    pub(super) gaussians: usize,
    /// Package bytes it would take before entropy coding.
    pub(super) bytes_saved: usize,
    /// Bytes it would take in GPU buffers.
    pub(super) gpu_bytes_saved: usize,
}

/// Every optional part that Gaussians of the package do without. Together they are the
/// difference to a package of which every Gaussian has every part.
pub(super) fn left_out(contents: &Contents, clip: &Clip) -> Vec<LeftOut> {
    let mut parts = Vec::new();
    let mut add = |part: String, gaussians: usize, package_bits: usize, gpu_words: usize| {
        parts.push(LeftOut {
            part,
            gaussians,
            bytes_saved: gaussians * package_bits / 8,
            gpu_bytes_saved: gaussians * gpu_words * 4,
        });
    };
    let (all, still) = (clip.len(), clip.still.len());
    for degree in contents.sh_degree + 1..=SH_DEGREE_MAX {
        let functions = 2 * usize::from(degree) + 1;
        let gpu_words = sh_words(degree) - sh_words(degree - 1);
        add(format!("SH degree {degree}"), all, functions * SH_FUNCTION_BITS, gpu_words);
    }
    let mut motion = Motion { order: contents.motion_order, rotates: contents.rotation_rates };
    if still > 0 {
        let powers = usize::from(motion.order) * MOTION_POWER_BITS;
        let rates = if motion.rotates { ROTATION_RATES_BITS } else { 0 };
        let part = "temporal columns of motionless Gaussians".to_owned();
        add(part, still, WINDOW_BITS + powers + rates, motion.words());
    }
    for order in contents.motion_order + 1..=MOTION_ORDER_MAX {
        let larger = Motion { order, ..motion };
        let gpu_words = larger.words() - motion.words();
        add(format!("motion of power {order}"), all, MOTION_POWER_BITS, gpu_words);
        motion = larger;
    }
    if !motion.rotates {
        let gpu_words = Motion { rotates: true, ..motion }.words() - motion.words();
        add("rotation over time".to_owned(), all, ROTATION_RATES_BITS, gpu_words);
    }
    if clip.plate.is_none() {
        // Its Gaussians would be its whole cost, and there are none.
        add("plate".to_owned(), 0, 0, 0);
    }
    parts
}

/// Bytes of the Gaussians in GPU buffers.
pub(super) fn gpu_bytes(contents: &Contents, clip: &Clip) -> usize {
    let record = |degree: u8| size_of::<layout::Gaussian>() + 4 * sh_words(degree);
    let motion = Motion { order: contents.motion_order, rotates: contents.rotation_rates };
    let plate = clip.plate.as_ref().map_or(0, |plate| plate.len() * record(plate.sh_degree));
    clip.len() * record(contents.sh_degree) + clip.moving.len() * 4 * motion.words() + plate
}
