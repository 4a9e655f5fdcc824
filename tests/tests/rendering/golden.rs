//! The demo scene looks as it did: the GPU's images of it match golden ones, which lavapipe drew.
//!
//! `UPDATE_GOLDEN=1 cargo test -p aarc-tests --test rendering golden` rewrites the golden images and
//! fails once, so that no image changes unseen.

use aarc_tests::gpu::{self, Drawing, Passes};
use aarc_tests::image::{Tolerance, check_golden};
use client::gpu::{ChannelDepth, Gpu, GpuClip, RenderSettings};
use codec::{Coder, EncodeOptions, Limits, Precision, Source};
use libtest_mimic::Trial;
use studio::synth::juggler;

/// PSNR of the coded scene in dB, so high that the images show the renderer and not the coder.
const EXACT_DB: f64 = 80.0;

/// Drivers differ in how they round 8-bit blending, platforms in the sines of the scene.
const TOLERANCE: Tolerance = Tolerance { max_diff: 12.0, diff_pixels: 400, psnr: 42.0 };

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    vec![gpu::trial("the demo scene", Passes::Shared, demo_scene)]
}

fn demo_scene(gpu: &Gpu) -> Result<(), String> {
    let (field, info) = juggler::clip();
    let source = Source { info: &info, field: &field, plate: None };
    let precision = Precision { psnr: EXACT_DB, ..Precision::default() };
    let options = EncodeOptions { coder: Coder::Rans, precision, ..EncodeOptions::default() };
    let bytes = codec::encode(&source, &options).map_err(|error| error.to_string())?;
    let clip = codec::decode(&bytes, &Limits::default()).map_err(|error| error.to_string())?;
    let camera = clip.info.viewpoints.first().ok_or("no viewpoint")?.camera(clip.info.up, 192, 192);
    let fault = |fault: program::Fault| fault.to_string();
    let uploaded = GpuClip::upload(gpu, &clip).map_err(fault)?;
    let mut drawing = Drawing::new(gpu, uploaded, &[camera], ChannelDepth::Eight).map_err(fault)?;
    let mut failures = Vec::new();
    for percent in [0, 40, 75] {
        let images = drawing.frame(f64::from(percent) / 100.0, &RenderSettings::default()).map_err(fault)?;
        failures.extend(check_golden(&format!("demo-{percent}"), &images[0], TOLERANCE).err());
    }
    if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
}
