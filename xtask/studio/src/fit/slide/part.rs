//! [`FittedPart`]: what the fit of a part of the take leaves, and what such a fit starts with: Gaussians of the parts
//! beside it, and anchors where these show nothing yet.

use refine::anchor::AnchorError;
use refine::capture::PhotoId;
use refine::fit::{Backend, Carried, Fit, FitSettings, Learned, Parameters, TrainingView};
use serde::{Deserialize, Serialize};

use super::past::{PartTime, Side};
use super::photographs::Photographs;
use super::rows::{joined, later, lives};
use super::shown::not_shown;
use super::windows::Windows;
use crate::fit::plan::FitPlan;
use crate::fit::start::{AnchorFault, anchored};
use crate::fit::training_views::TrainingViews;

/// What the fit of a part left; times count in intervals from the first photograph of the part.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct FittedPart {
    /// Seconds of fitting.
    pub(super) seconds: f64,
    /// Name of the graphics device that computed steps, if any did.
    pub(super) device: Option<String>,
    /// Gaussians that no other part changes.
    pub(super) finished: Parameters<f32>,
    /// Gaussians for the part before, if it was not fitted yet: they are alive in its photographs.
    pub(super) before: Parameters<f32>,
    /// The same for the part after.
    pub(super) after: Parameters<f32>,
}

/// The parts before and after one, where they are finished.
pub(super) type Beside = [Option<FittedPart>; 2];

/// Whether the parts before and after one are finished.
pub(super) fn is_finished(beside: &Beside) -> [bool; 2] {
    beside.each_ref().map(Option::is_some)
}

/// What the fit of a part starts with.
pub(super) enum Start {
    /// A fit before its first step.
    Fit(Box<Fit>),
    /// There is nothing to fit: no photograph, or no subject and nothing of the parts beside it.
    Nothing {
        /// Gaussians of these parts.
        carried: Box<Parameters<f32>>,
        /// Why there is no anchor.
        why: Option<AnchorError>,
    },
}

/// The start of the fit of a part, with the `background` of the take.
///
/// # Errors
/// Those of the anchor, and of the device.
pub(super) fn start(
    plan: &FitPlan,
    photographs: &Photographs,
    part: usize,
    views: &TrainingViews,
    background: &Parameters<f32>,
    beside: Beside,
    backend: &mut dyn Backend,
) -> anyhow::Result<Start> {
    let &Photographs { capture_files, windows, interval_s, .. } = photographs;
    let is_finished = is_finished(&beside);
    let time = PartTime::new(&windows, part, interval_s, is_finished);
    let is_new = |photo_id: PhotoId| windows.is_new(part, is_finished, photographs.time_s(photo_id));
    let new: Vec<&(PhotoId, TrainingView)> = views.train.iter().filter(|(id, _)| is_new(*id)).collect();
    let from_s = windows.span_s(part)[0];
    let frame_time = |frame: usize| (capture_files.capture.frame_times_s[frame] - from_s) / interval_s;
    let gaussians = (plan.gaussians as f64 * windows.new_units(part, is_finished)).ceil() as usize;
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
    let mut fixed = background.clone();
    // It is where it is at any time.
    fixed.tau.fill((0.5 * time.end) as f32);
    let (finished, mut parameters, mut pasts) = carried(photographs, part, beside, &time);
    fixed = joined(fixed, finished);
    if let Some(anchors) = anchors {
        let shown = joined(fixed.clone(), parameters.clone());
        let anchors = anchors.select(&not_shown(&shown, &anchors, &new, backend)?);
        pasts.resize(pasts.len() + anchors.len(), time.own());
        parameters = joined(parameters, anchors);
    }
    if parameters.is_empty() || views.train.is_empty() {
        return Ok(Start::Nothing { carried: Box::new(parameters), why: without_anchor });
    }
    // The limits of capacity control are the limits of what this part fits.
    let of_part = |gaussians: usize| fixed.len() + (gaussians as f64 * windows.units(part)).ceil() as usize;
    let (floor, cap) = (of_part(plan.floor), of_part(2 * plan.gaussians));
    let settings = FitSettings { floor, cap: Some(cap), ..plan.fit_settings() };
    pasts.resize(pasts.len() + fixed.len(), Carried::FIXED);
    let cameras = capture_files.capture.cameras.iter().map(|camera| &camera.camera);
    let fit = Fit::new(settings, joined(parameters, fixed), views.timeline, cameras);
    Ok(Start::Fit(Box::new(fit.carrying(pasts).seen_by(views.rig(Learned::default())))))
}

/// What the finished parts beside one leave to it: Gaussians in its photographs that stay as they are, Gaussians that
/// it continues, and the pasts of these.
fn carried(
    photographs: &Photographs,
    part: usize,
    beside: Beside,
    time: &PartTime,
) -> (Parameters<f32>, Parameters<f32>, Vec<Carried>) {
    let &Photographs { windows, interval_s, .. } = photographs;
    let (mut fixed, mut carried, mut pasts) = (Parameters::default(), Parameters::default(), Vec::new());
    let there = Side::BOTH.into_iter().zip(beside).zip(windows.beside(part));
    for ((side, fitted), number) in there {
        let Some((FittedPart { finished, before, after, .. }, number)) = fitted.zip(number) else { continue };
        let lives = lives(&finished, interval_s, windows.span_s(number));
        let is_seen = |life: &Option<[f64; 2]>| life.is_some_and(|life| is_alive_in(&windows, part, life));
        let rows: Vec<usize> = (0..lives.len()).filter(|row| is_seen(&lives[*row])).collect();
        let shift = (windows.span_s(part)[0] - windows.span_s(number)[0]) / interval_s;
        fixed = joined(fixed, later(finished.select(&rows), shift));
        // This part takes the Gaussians that the part before leaves to the part after it.
        let open = match side {
            Side::Before => after,
            Side::After => before,
        };
        let open = later(open, shift);
        pasts.extend(time.carried(&open, side));
        carried = joined(carried, open);
    }
    (fixed, carried, pasts)
}

/// Whether a life from birth to death, in seconds of the take, is in the window of a part.
fn is_alive_in(windows: &Windows, part: usize, [birth_s, death_s]: [f64; 2]) -> bool {
    let [from_s, to_s] = windows.span_s(part);
    death_s > from_s && birth_s < to_s
}

/// Divides what was fitted in `part` into Gaussians that are finished and Gaussians that a part beside it continues. A
/// Gaussian that is alive in both of these parts, while neither is finished, is finished: they could not continue it
/// together.
pub(super) fn divided(
    fitted: &Parameters<f32>,
    photographs: &Photographs,
    part: usize,
    is_finished: [bool; 2],
) -> FittedPart {
    let &Photographs { windows, interval_s, .. } = photographs;
    let beside = windows.beside(part);
    let mut rows: [Vec<usize>; 3] = Default::default();
    for (row, life) in lives(fitted, interval_s, windows.span_s(part)).into_iter().enumerate() {
        let Some(life) = life else { continue };
        let goes_on = |side: usize| {
            !is_finished[side] && beside[side].is_some_and(|beside| is_alive_in(&windows, beside, life))
        };
        match [goes_on(0), goes_on(1)] {
            [true, false] => rows[1].push(row),
            [false, true] => rows[2].push(row),
            [true, true] | [false, false] => rows[0].push(row),
        }
    }
    let [finished, before, after] = rows.map(|rows| fitted.select(&rows));
    FittedPart { finished, before, after, ..FittedPart::default() }
}
