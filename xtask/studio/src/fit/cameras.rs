//! The cameras of a fit, for the file beside its field.

use refine::fit::{Fit, Timeline};

use crate::capture::{CameraCorrections, CaptureFiles};

/// The cameras of the capture as `fit` has them; `None` if they are as the capture states them, in the colours of the
/// field.
pub fn learned_cameras(
    capture_files: &CaptureFiles,
    fit: &Fit,
    timeline: Timeline,
) -> Option<CameraCorrections> {
    let Some(rig) = fit.rig() else {
        return capture_files.is_corrected().then(|| capture_files.corrections());
    };
    let mut learned = capture_files.clone();
    let interval_s = learned.capture.duration_s() / timeline.intervals;
    for (i, camera) in learned.capture.cameras.iter_mut().enumerate() {
        camera.camera = rig.corrected(i, &camera.camera);
        camera.time_offset_s += rig.late(i) * interval_s;
        camera.response = rig.response(i);
    }
    Some(learned.corrections())
}
