//! [`not_shown`]: which anchors show something that Gaussians do not show yet.

use std::collections::BTreeMap;

use program::Fault;
use refine::capture::PhotoId;
use refine::fit::{Backend, FrameView, Parameters, TrainingState, TrainingView};

use crate::fit::on_device;

/// Alpha and largest error of a channel at which a pixel counts as shown.
const SHOWN_ALPHA: f32 = 0.5;
pub(super) const SHOWN_ERROR: f32 = 0.1;

/// The rows of `anchors` that `parameters` do not show yet: in the photograph of some camera of their frame, their pixel
/// is not covered, or has another colour.
pub(super) fn not_shown(
    parameters: &Parameters<f32>,
    anchors: &Parameters<f32>,
    views: &[&(PhotoId, TrainingView)],
    backend: &mut dyn Backend,
) -> Result<Vec<usize>, Fault> {
    if parameters.is_empty() {
        return Ok((0..anchors.len()).collect());
    }
    let mut rows_of: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (row, tau) in anchors.tau.iter().enumerate() {
        rows_of.entry(tau.to_bits()).or_default().push(row);
    }
    let mut is_shown = vec![true; anchors.len()];
    backend.load(TrainingState::from(parameters.clone())).map_err(on_device)?;
    for (_, view) in views {
        // Anchors have the times of their frames, from which the times of cameras may be offset.
        let nearest = rows_of.keys().copied().min_by(|a, b| {
            let distance = |bits: &u32| (f64::from(f32::from_bits(*bits)) - view.time).abs();
            distance(a).total_cmp(&distance(b))
        });
        let Some(rows) = nearest.map(|time| &rows_of[&time]) else { continue };
        let frame_view = FrameView { camera: &view.camera, time: view.time };
        let picture = backend.render(&frame_view).map_err(on_device)?;
        for &row in rows {
            let Some(pixel) = view.pixel_of(anchors.centers[row].map(f64::from)) else { continue };
            if !view.photograph.is_valid(pixel) {
                continue;
            }
            let (drawn, taken) = (picture.pixels[pixel], view.photograph.pixels[pixel]);
            let error = (0..3).map(|c| (drawn[c] - f32::from(taken[c]) / 255.0).abs()).fold(0.0, f32::max);
            is_shown[row] &= drawn[3] > SHOWN_ALPHA && error < SHOWN_ERROR;
        }
    }
    // The memory is for the fit.
    drop(backend.store().map_err(on_device)?);
    Ok((0..anchors.len()).filter(|row| !is_shown[*row]).collect())
}
