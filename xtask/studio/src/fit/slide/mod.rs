//! The sliding fit: a capture of minutes becomes a field folder, with the memory of a few seconds.
//!
//! ```text
//! step:  photographs of a window, the next ones read ahead
//!        Gaussians of the step before + anchors where these show nothing -> Fit -> finished | carried on
//! end:   all that is finished -> segments by life -> field folder
//! ```
//!
//! A Gaussian is finished when it is dead before the photographs of the next step begin. Until then it takes part in
//! every step, with shorter steps the more of its life is over: [`Carried`](refine::fit::Carried).

mod assemble;
mod background;
mod past;
mod photographs;
mod plan;
mod shown;
mod step;
mod windows;
mod work_folder;

use std::thread;
use std::time::Instant;

use anyhow::bail;
use program::Fault;
use refine::anchor::AnchorError;
use refine::fit::{Backend, Parameters};

use super::{FitProgress, FitRuntime, clip_info, fit_from};
use crate::capture::CaptureFiles;
use crate::import::FitRecord;
pub use assemble::Assembled;
use assemble::{assemble, lives};
use background::background;
use photographs::{Loaded, Photographs};
pub use plan::SlidePlan;
use step::Start;
use windows::Windows;
use work_folder::State;
pub use work_folder::WorkFolder;

/// Progress of a sliding fit.
#[derive(Clone, Copy, Debug)]
pub struct SlideProgress {
    /// The step, from 0.
    pub step: usize,
    /// Number of steps.
    pub steps: usize,
    /// Progress within the step.
    pub fit: FitProgress,
}

/// A field folder that was fitted.
#[derive(Clone, Debug)]
pub struct SlidField {
    /// What was written.
    pub assembled: Assembled,
    /// Number of steps.
    pub steps: usize,
    /// Number of steps that an earlier process had done.
    pub resumed_at: usize,
    /// Seconds of fitting, earlier processes included.
    pub seconds: f64,
}

/// What a sliding fit needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlideCost {
    /// Number of steps.
    pub steps: usize,
    /// Estimated peak memory in bytes.
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

/// Largest number of parts of the take with photographs in memory: a window, and what is read ahead.
const UNITS_MAX: f64 = 2.75;

/// Estimates what a sliding fit needs, from the Gaussians and photographs of a part.
pub fn slide_cost(plan: &SlidePlan, capture_files: &CaptureFiles) -> SlideCost {
    let capture = &capture_files.capture;
    let steps = Windows::new(capture.duration_s(), plan.unit_s).count;
    let bytes = |camera: &refine::capture::CalibratedCamera| {
        4.0 * f64::from(camera.camera.width) * f64::from(camera.camera.height)
    };
    let frame_bytes: f64 = capture.cameras.iter().map(bytes).sum();
    let frames = capture.frames() as f64 * (UNITS_MAX * plan.unit_s / capture.duration_s()).min(1.0);
    let gaussians = 2.0 * plan.fit.gaussians as f64;
    SlideCost {
        steps,
        memory_bytes: PROCESS_BYTES + frames * frame_bytes + 1.75 * gaussians * FITTED_BYTES,
        // Parts and segments are there together for a moment.
        disk_bytes: 2.0 * steps as f64 * gaussians * STORED_BYTES,
    }
}

/// Fits a field folder to a capture.
///
/// # Errors
/// A [`Fault`] if a photograph or the folder cannot be read or written, or the device fails. What was finished stays,
/// and the same call goes on from there.
pub fn slide(
    plan: &SlidePlan,
    capture_files: &CaptureFiles,
    runtime: FitRuntime,
    mut work: WorkFolder,
    on_progress: &mut dyn FnMut(&SlideProgress),
) -> anyhow::Result<SlidField> {
    let FitRuntime { backend, lpips, checkpoint_every } = runtime;
    let duration_s = capture_files.capture.duration_s();
    let windows = Windows::new(duration_s, plan.unit_s);
    let photographs = Photographs::new(capture_files, windows, plan.fit.holdout)?;
    let interval_s = photographs.interval_s;
    let mut state = match work.state.take() {
        Some(state) => state,
        None => {
            let state = begin(plan, &photographs, backend)?;
            work.write_state(&state)?;
            state
        }
    };
    let resumed_at = state.next;
    let [mut before, mut new] = first_photographs(&photographs, resumed_at)?;
    let mut without_anchor = None;
    for step in resumed_at..windows.count {
        let start = Instant::now();
        let views = photographs.views(step, before, new)?;
        let carried = std::mem::take(&mut state.carried);
        let mut passed_on = Parameters::default();
        let begin = |backend: &mut dyn Backend| {
            Ok(match step::start(&plan.fit, &photographs, step, &views, carried, backend)? {
                Start::Fit(fit) => Some(*fit),
                Start::Nothing { carried, why } => {
                    passed_on = *carried;
                    without_anchor = without_anchor.take().or(why);
                    None
                }
            })
        };
        let mut on_fit =
            |fit: &FitProgress| on_progress(&SlideProgress { step, steps: windows.count, fit: *fit });
        let runtime = FitRuntime { backend: &mut *backend, lpips, checkpoint_every };
        let (fitted, ahead) = thread::scope(|scope| {
            let ahead = (step + 1 < windows.count).then(|| scope.spawn(|| photographs.load_new(step + 1)));
            let fitted =
                fit_from(&plan.fit, capture_files, &views, runtime, &work.step(step), &mut on_fit, begin);
            (fitted, ahead.map(|ahead| ahead.join().expect("no panic")))
        });
        let fitted = fitted?.map_or(passed_on, |fitted| fitted.parameters);
        let [finished, going_on] = divided(&fitted, &windows, step, interval_s);
        (state.carried, state.next) = (going_on, step + 1);
        state.seconds += start.elapsed().as_secs_f64();
        work.complete(step, &finished, &state)?;
        new = ahead.transpose()?.unwrap_or_default();
        before = views.train;
    }
    let assembled = whole(plan, &photographs, &work, without_anchor)?;
    work.remove()?;
    Ok(SlidField { assembled, steps: windows.count, resumed_at, seconds: state.seconds })
}

/// Makes the field folder of what all steps finished; `without_anchor` says why a step had no anchor.
fn whole(
    plan: &SlidePlan,
    photographs: &Photographs,
    work: &WorkFolder,
    without_anchor: Option<AnchorError>,
) -> anyhow::Result<Assembled> {
    let &Photographs { capture_files, windows, interval_s, .. } = photographs;
    let record = FitRecord { holdout: Some(plan.fit.holdout), ..Default::default() };
    let info = clip_info(capture_files);
    let times = [capture_files.capture.duration_s(), plan.unit_s];
    let Some(assembled) = assemble(work, &windows, interval_s, times, &info, &record)? else {
        let why = without_anchor.map_or_else(String::new, |error| format!("no anchor: {error}; "));
        let out = work.out.display();
        bail!(Fault::Data(format!(
            "{why}no part of the take has a Gaussian; remove {out}/fit and choose another --anchor"
        )));
    };
    Ok(assembled)
}

/// The state before the first step: the background of a take of several parts.
fn begin(plan: &SlidePlan, photographs: &Photographs, backend: &mut dyn Backend) -> Result<State, Fault> {
    let &Photographs { capture_files, windows, interval_s, .. } = photographs;
    let taken = capture_files.capture.duration_s() / interval_s;
    let carried = match windows.count {
        1 => Parameters::default(),
        _ => background(&plan.fit, capture_files, &photographs.spread()?, taken, backend)?,
    };
    Ok(State { plan: plan.clone(), next: 0, carried, seconds: 0.0 })
}

/// The photographs that step `step` shares with the one before it, and its new ones.
fn first_photographs(photographs: &Photographs, step: usize) -> Result<[Loaded; 2], Fault> {
    if step >= photographs.windows.count {
        return Ok([Vec::new(), Vec::new()]);
    }
    let before = if step > 0 { photographs.load_seen_before(step)? } else { Vec::new() };
    Ok([before, photographs.load_new(step)?])
}

/// The rows that are as they stay after step `step`, with times in its intervals, and the others that are ever alive, with
/// times in intervals of the next step.
fn divided(
    fitted: &Parameters<f32>,
    windows: &Windows,
    step: usize,
    interval_s: f64,
) -> [Parameters<f32>; 2] {
    let (mut finished, mut going_on) = (Vec::new(), Vec::new());
    for (row, life) in lives(fitted, interval_s, windows.span_s(step)).into_iter().enumerate() {
        match life {
            Some([_, death_s]) if death_s <= windows.final_until_s(step) => finished.push(row),
            Some(_) => going_on.push(row),
            None => {}
        }
    }
    let [finished, mut going_on] = [finished, going_on].map(|rows| fitted.select(&rows));
    if step + 1 < windows.count {
        let shift = (windows.span_s(step + 1)[0] - windows.span_s(step)[0]) / interval_s;
        going_on.tau.iter_mut().for_each(|tau| *tau = (f64::from(*tau) - shift) as f32);
    }
    [finished, going_on]
}
