//! [`SlideCost`]: what a sliding fit needs, estimated before it begins.

use super::plan::SlidePlan;
use super::windows::Windows;
use crate::capture::CaptureFiles;

/// What a sliding fit needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlideCost {
    /// Number of parts of the take.
    pub parts: usize,
    /// Estimated peak memory of a process in bytes.
    pub memory_bytes: f64,
    /// Estimated largest size of the folder in bytes.
    pub disk_bytes: f64,
}

/// Numbers of a Gaussian: its parameters as stored, and with gradient and moments as in memory.
const NUMBERS_MAX: f64 = 3.0 + 4.0 + 3.0 + 1.0 + 48.0 + 2.0 + 9.0 + 4.0;
const STORED_BYTES: f64 = 4.0 * NUMBERS_MAX;
const FITTED_BYTES: f64 = 4.0 * STORED_BYTES;

/// The program itself.
const PROCESS_BYTES: f64 = 20e6;

/// Estimates what a sliding fit needs, from the Gaussians and photographs of a part.
pub fn slide_cost(plan: &SlidePlan, capture_files: &CaptureFiles) -> SlideCost {
    let capture = &capture_files.capture;
    let windows = Windows::new(capture.duration_s(), plan.unit_s);
    let bytes = |camera: &refine::capture::CalibratedCamera| {
        4.0 * f64::from(camera.camera.width) * f64::from(camera.camera.height)
    };
    let frame_bytes: f64 = capture.cameras.iter().map(bytes).sum();
    let units = (0..windows.count).map(|part| windows.units(part)).fold(0.0, f64::max);
    let frames = capture.frames() as f64 * (units * plan.unit_s / capture.duration_s()).min(1.0);
    // Those of a part, as many again that densification adds, and the background.
    let gaussians = 2.0 * plan.fit.gaussians as f64;
    SlideCost {
        parts: windows.count,
        memory_bytes: PROCESS_BYTES + frames * frame_bytes + (units + 0.5) * gaussians * FITTED_BYTES,
        // Parts and segments are there together for a moment.
        disk_bytes: 2.0 * windows.count as f64 * gaussians * STORED_BYTES,
    }
}
