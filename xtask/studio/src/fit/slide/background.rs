//! [`background`]: the Gaussians of what stands still over the whole take, such as a floor and furniture.
//!
//! A few frames, evenly over the take, are anchored as others are. A Gaussian is still if the pixels that show it in its
//! own frame have the same colour in the other frames. It is always on, and a step of the fit then anchors only
//! what moves.

use codec::{SH_C0, sh_coefficients};
use program::Fault;
use refine::capture::PhotoId;
use refine::fit::{Backend, Parameters, TrainingView};

use super::shown::{SHOWN_ERROR, joined, not_shown, pixel_of};
use crate::capture::CaptureFiles;
use crate::fit::plan::FitPlan;
use crate::fit::start::{AnchorFault, anchored};
use crate::fit::training_views::{TrainingViews, by_frame};

/// Largest difference of a channel, of 255, between two photographs of what stands still: noise and rounding.
const SAME: u8 = 10;

/// Share of the photographs that must agree: something may pass in front.
const AGREEING: f64 = 0.95;

/// Width of the window of what is always on, in takes.
const ALWAYS: f64 = 16.0;

/// Gaussians of what stands still in `views`, photographs of frames from all over the take, `taken` intervals long.
/// Their times count in intervals of the take.
///
/// # Errors
/// Those of the anchor, and of the device.
pub(super) fn background(
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    views: &TrainingViews,
    taken: f64,
    backend: &mut dyn Backend,
) -> Result<Parameters<f32>, Fault> {
    let mut all = Parameters::default();
    for own in by_frame(&views.train).values() {
        let time = |_| own[0].1.time;
        let anchors = match anchored(plan, plan.gaussians, capture_files, views, own, &time) {
            Ok(anchors) => anchors,
            Err(AnchorFault::Anchor(error)) if error.is_of_one_frame() => continue,
            Err(fault) => return Err(fault.into_fault()),
        };
        let rows: Vec<usize> =
            (0..anchors.len()).filter(|row| is_static(&anchors, *row, own, views)).collect();
        let mut rows = anchors.select(&rows);
        rows.motion.fill([0.0; 3]);
        rows.log_widths.fill(libm::log(ALWAYS * taken) as f32);
        let rows = rows.select(&not_shown(&all, &rows, own, backend)?);
        all = joined(all, rows);
    }
    Ok(all)
}

/// Whether the pixels that show a row in its own frame have the same colour in the other frames.
fn is_static(
    anchors: &Parameters<f32>,
    row: usize,
    own: &[&(PhotoId, TrainingView)],
    views: &TrainingViews,
) -> bool {
    let base = anchors.sh[row * sh_coefficients(anchors.sh_degree)];
    let color = base.map(|c| 0.5 + SH_C0 as f32 * c);
    let center = anchors.centers[row].map(f64::from);
    let (mut agreeing, mut compared) = (0, 0);
    for (photo_id, view) in own {
        let Some(pixel) = pixel_of(&view.camera, center) else { continue };
        let taken = view.photograph.pixels[pixel];
        let is_seen = view.photograph.is_subject(pixel)
            && (0..3).all(|c| (f32::from(taken[c]) / 255.0 - color[c]).abs() < SHOWN_ERROR);
        if !is_seen {
            continue;
        }
        let others =
            views.train.iter().filter(|(other, _)| other.camera == photo_id.camera && other != photo_id);
        for (_, other) in others {
            if !other.photograph.is_valid(pixel) {
                continue;
            }
            let then = other.photograph.pixels[pixel];
            compared += 1;
            agreeing += usize::from((0..4).all(|c| then[c].abs_diff(taken[c]) <= SAME));
        }
    }
    compared > 0 && f64::from(agreeing as u32) >= AGREEING * f64::from(compared as u32)
}
