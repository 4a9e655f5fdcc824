//! [`Start`]: what a step of a sliding fit begins with: Gaussians of the step before it, and anchors where these show
//! nothing yet.

use refine::anchor::AnchorError;
use refine::capture::PhotoId;
use refine::fit::{Backend, Fit, FitSettings, Parameters, TrainingView};

use super::past::past;
use super::photographs::Photographs;
use super::shown::{joined, not_shown};
use crate::fit::plan::FitPlan;
use crate::fit::start::{AnchorFault, anchored};
use crate::fit::training_views::TrainingViews;

/// What a step begins with.
pub(super) enum Start {
    /// A fit before its first step.
    Fit(Box<Fit>),
    /// There is nothing to fit: no photograph, or no subject and nothing from before.
    Nothing {
        /// Gaussians of the step before, with times in intervals of this step.
        carried: Box<Parameters<f32>>,
        /// Why there is no anchor.
        why: Option<AnchorError>,
    },
}

/// The start of step `step`. `carried` has times in intervals of this step.
///
/// # Errors
/// Those of the anchor, and of the device.
pub(super) fn start(
    plan: &FitPlan,
    photographs: &Photographs,
    step: usize,
    views: &TrainingViews,
    carried: Parameters<f32>,
    backend: &mut dyn Backend,
) -> anyhow::Result<Start> {
    let &Photographs { capture_files, windows, interval_s, .. } = photographs;
    let [from_s, to_s] = windows.span_s(step);
    let is_new = |photo_id: PhotoId| windows.sees_first(step, capture_files.capture.time_s(photo_id));
    let new: Vec<&(PhotoId, TrainingView)> = views.train.iter().filter(|(id, _)| is_new(*id)).collect();
    let frame_time = |frame: usize| (capture_files.capture.frame_times_s[frame] - from_s) / interval_s;
    let gaussians = (plan.gaussians as f64 * windows.new_units(step)).ceil() as usize;
    let mut without_anchor = None;
    let anchors = match anchored(plan, gaussians, capture_files, views, &new, &frame_time) {
        Ok(anchors) => Some(anchors),
        // The subject is not there, or no camera took a photograph.
        Err(AnchorFault::Anchor(error)) if error.is_of_one_frame() || new.is_empty() => {
            without_anchor = Some(error);
            None
        }
        Err(fault) => return Err(fault.into_fault().into()),
    };
    let take = [-from_s, capture_files.capture.duration_s() - from_s].map(|second| second / interval_s);
    let end = (to_s - from_s) / interval_s;
    let mut pasts = past(&carried, take, end);
    let mut parameters = carried;
    // What stands still is where it is at any time.
    for (row, _) in pasts.iter().enumerate().filter(|(_, past)| past.is_static) {
        parameters.tau[row] = (end / 2.0) as f32;
    }
    if let Some(anchors) = anchors {
        let anchors = anchors.select(&not_shown(&parameters, &anchors, &new, backend)?);
        pasts.extend(past(&anchors, take, end));
        parameters = joined(parameters, anchors);
    }
    if parameters.is_empty() || views.train.is_empty() {
        return Ok(Start::Nothing { carried: Box::new(parameters), why: without_anchor });
    }
    let floor = (plan.floor as f64 * windows.units(step)).ceil() as usize;
    let cap = 2 * (plan.gaussians as f64 * windows.units(step)).ceil() as usize;
    let settings = FitSettings { floor, cap: Some(cap), ..plan.fit_settings() };
    let cameras = capture_files.capture.cameras.iter().map(|camera| &camera.camera);
    let fit = Fit::new(settings, parameters, views.timeline, cameras);
    Ok(Start::Fit(Box::new(fit.carrying(pasts))))
}
