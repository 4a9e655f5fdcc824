//! The file of cameras beside a field: what its fit learned of them.

use std::path::{Path, PathBuf};

use refine::fit::{Fit, Timeline};

use crate::capture::{CameraCorrections, CaptureFiles};
use crate::scene::beside;

/// Path of the cameras that were learned with a field: beside a field file or a package of it, in a field folder.
pub fn cameras_path(field: &Path) -> PathBuf {
    if field.is_dir() { field.join("cameras.json") } else { beside(field, "cameras.json") }
}

/// The cameras of the capture as `fit` has them; `None` if they are as the capture states them, in the colours of the
/// field.
pub fn learned_cameras(
    capture_files: &CaptureFiles,
    fit: &Fit,
    timeline: Timeline,
) -> Option<CameraCorrections> {
    let rig = fit.rig()?;
    let mut learned = capture_files.clone();
    let interval_s = learned.capture.duration_s() / timeline.intervals;
    for (i, camera) in learned.capture.cameras.iter_mut().enumerate() {
        camera.camera = rig.corrected(i, &camera.camera);
        camera.time_offset_s += rig.late(i) * interval_s;
        camera.response = rig.response(i);
    }
    Some(learned.corrections())
}
