//! [`background`]: the Gaussians of what stands still over the whole take, such as a floor and furniture.
//!
//! A few frames, evenly over the take, are anchored as others are. A Gaussian is still if the pixels that show it in its
//! own frame have the same colour in the other frames. It is always on. These are fitted to those pixels of the few
//! frames that have the same colour in most of them; then they stay as they are in the fit of every part, which anchors
//! and fits only what moves.

use std::path::Path;

use codec::{SH_C0, sh_coefficients};
use program::Fault;
use refine::capture::PhotoId;
use refine::fit::{Backend, Carried, Fit, Learned, Parameters, TrainingView};

use super::part::FittedPart;
use super::photographs::Photographs;
use super::rows::joined;
use super::shown::{SHOWN_ERROR, not_shown};
use crate::fit::plan::FitPlan;
use crate::fit::start::{ALWAYS, AnchorFault, anchored};
use crate::fit::training_views::{TrainingViews, by_frame};
use crate::fit::{FitProgress, FitRuntime, fit_from};

/// Largest difference of a channel, of 255, between two photographs of what stands still: noise and rounding.
const SAME: u8 = 10;

/// Share of the photographs that must agree: something may pass in front.
const AGREEING: f64 = 0.95;

/// The fitted background; times count in intervals of the take. `out` is the path of the files of the fit, without
/// extension.
///
/// # Errors
/// A [`Fault`] if a photograph cannot be read, a file cannot be written, or the device fails.
pub(super) fn background(
    plan: &FitPlan,
    photographs: &Photographs,
    runtime: FitRuntime,
    out: &Path,
    on_progress: &mut dyn FnMut(&FitProgress),
) -> anyhow::Result<FittedPart> {
    let capture_files = photographs.capture_files;
    let mut views = photographs.spread()?;
    let anchors = anchors(plan, photographs, &views, &mut *runtime.backend)?;
    if anchors.is_empty() {
        return Ok(FittedPart::default());
    }
    leave_out_what_moves(&mut views);
    let cameras = capture_files.capture.cameras.iter().map(|camera| &camera.camera);
    let carried = vec![Carried::STATIC; anchors.len()];
    let fit = Fit::new(plan.fit_settings(), anchors, views.timeline, cameras).carrying(carried);
    let fit = fit.seen_by(views.rig(Learned::default()));
    let fitted = fit_from(plan, capture_files, &views, runtime, out, on_progress, |_| Ok(Some(fit)))?;
    let fitted = fitted.expect("there is something to fit");
    let device = fitted.device();
    Ok(FittedPart { device, finished: fitted.fit.into_fitted(), ..FittedPart::default() })
}

/// Gaussians of what stands still in `views`, photographs of frames from all over the take.
///
/// # Errors
/// Those of the anchor, and of the device.
fn anchors(
    plan: &FitPlan,
    photographs: &Photographs,
    views: &TrainingViews,
    backend: &mut dyn Backend,
) -> Result<Parameters<f32>, Fault> {
    let mut all = Parameters::default();
    for own in by_frame(&views.train).values() {
        let time = |_| own[0].1.time;
        let anchored = anchored(plan, plan.gaussians, photographs.capture_files, views, own, &time);
        let anchors = match anchored {
            Ok(anchors) => anchors,
            Err(AnchorFault::Anchor(error)) if error.is_of_one_frame() => continue,
            Err(fault) => return Err(fault.into_fault()),
        };
        let rows: Vec<usize> =
            (0..anchors.len()).filter(|row| is_static(&anchors, *row, own, views)).collect();
        let mut rows = anchors.select(&rows);
        rows.motion.fill([0.0; 3]);
        rows.log_widths.fill(libm::log(ALWAYS * views.timeline.intervals) as f32);
        let rows = rows.select(&not_shown(&all, &rows, own, backend)?);
        all = joined(all, rows);
    }
    // Where the ends of the take are nearest, so that a package counts it as static.
    all.tau.fill((0.5 * views.timeline.intervals) as f32);
    Ok(all)
}

/// Marks the pixels as not valid that have another colour in most of the other photographs of their camera.
fn leave_out_what_moves(views: &mut TrainingViews) {
    let is_kept = |(photo_id, view): &(PhotoId, TrainingView)| -> Vec<bool> {
        let photograph = &view.photograph;
        let others: Vec<_> = others(views, *photo_id).map(|other| &other.photograph).collect();
        let is_steady = |pixel: &usize| {
            let valid: Vec<_> = others.iter().filter(|other| other.is_valid(*pixel)).collect();
            let agreeing =
                valid.iter().filter(|other| is_same(other.pixels[*pixel], photograph.pixels[*pixel]));
            2 * agreeing.count() >= valid.len()
        };
        (0..photograph.pixels.len()).map(|pixel| photograph.is_valid(pixel) && is_steady(&pixel)).collect()
    };
    let kept: Vec<Vec<bool>> = views.train.iter().map(is_kept).collect();
    for ((_, view), kept) in views.train.iter_mut().zip(kept) {
        view.photograph.valid = kept;
    }
}

/// The other views of the same camera.
fn others(views: &TrainingViews, photo_id: PhotoId) -> impl Iterator<Item = &TrainingView> {
    let is_other = move |other: PhotoId| other.camera == photo_id.camera && other != photo_id;
    views.train.iter().filter(move |(other, _)| is_other(*other)).map(|(_, view)| view)
}

/// Whether two pixels show the same.
fn is_same(a: [u8; 4], b: [u8; 4]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= SAME)
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
        let Some(pixel) = view.pixel_of(center) else { continue };
        let taken = view.photograph.pixels[pixel];
        let is_seen = view.photograph.is_subject(pixel)
            && (0..3).all(|c| (f32::from(taken[c]) / 255.0 - color[c]).abs() < SHOWN_ERROR);
        if !is_seen {
            continue;
        }
        for other in others(views, *photo_id).filter(|other| other.photograph.is_valid(pixel)) {
            compared += 1;
            agreeing += usize::from(is_same(other.photograph.pixels[pixel], taken));
        }
    }
    compared > 0 && f64::from(agreeing as u32) >= AGREEING * f64::from(compared as u32)
}
