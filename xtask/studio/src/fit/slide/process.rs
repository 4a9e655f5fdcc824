//! [`Process`]: the fits of a process, of the background and of some parts, one after another.

use std::thread;
use std::time::Instant;

use program::Fault;
use refine::anchor::AnchorError;
use refine::fit::{Backend, Parameters};

use super::background::background;
use super::part::{self, FittedPart, Start, divided, is_finished};
use super::photographs::{Loaded, Photographs};
use super::plan::SlidePlan;
use super::work_folder::{Claim, WorkFolder};
use crate::fit::{FitProgress, FitRuntime, Fitted, fit_from};

/// Progress of a sliding fit.
#[derive(Clone, Copy, Debug)]
pub struct SlideProgress {
    /// The part; `None` for the background.
    pub part: Option<usize>,
    /// Steps that this process has done.
    pub done: u64,
    /// Steps that it does in all.
    pub steps: u64,
    /// Progress within the part.
    pub fit: FitProgress,
}

/// What the fits of a process share.
pub(super) struct Process<'a, 'b> {
    pub(super) plan: &'a SlidePlan,
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) runtime: &'a mut FitRuntime<'b>,
    pub(super) work: &'a WorkFolder,
    /// Why a part had no anchor.
    pub(super) without_anchor: Option<AnchorError>,
}

impl Process<'_, '_> {
    /// Fits the background, if there is none yet, and some parts. Of parts that are `apart`, one whose photographs cannot
    /// be read does not keep the others from being fitted.
    ///
    /// # Errors
    /// That of the first part that fails.
    pub(super) fn fit(
        &mut self,
        parts: &[usize],
        apart: bool,
        on_progress: &mut dyn FnMut(&SlideProgress),
    ) -> anyhow::Result<()> {
        if parts.is_empty() {
            return Ok(());
        }
        let steps = self.plan.fit.steps;
        let all = steps * parts.len() as u64;
        let background = self.background(&mut |fit| {
            on_progress(&SlideProgress { part: None, done: fit.step, steps: all + steps, fit: *fit });
        })?;
        let mut in_memory = Loaded::new();
        let mut failed = None;
        for (i, part) in parts.iter().enumerate() {
            let Some(claim) = self.work.claim(*part, &self.photographs.windows)? else { continue };
            let on_fit = &mut |fit: &FitProgress| {
                let done = i as u64 * steps + fit.step;
                on_progress(&SlideProgress { part: Some(*part), done, steps: all, fit: *fit });
            };
            match self.part(claim, &background.finished, in_memory, parts.get(i + 1).copied(), on_fit) {
                Ok(photographs) => in_memory = photographs,
                Err(error) if apart && matches!(error.downcast_ref(), Some(Fault::Data(_))) => {
                    failed = failed.or(Some(error));
                    in_memory = Loaded::new();
                }
                Err(error) => return Err(error),
            }
        }
        failed.map_or(Ok(()), Err)
    }

    /// The background of a take of several parts.
    fn background(&mut self, on_fit: &mut dyn FnMut(&FitProgress)) -> anyhow::Result<FittedPart> {
        let Process { plan, photographs, runtime, work, .. } = self;
        work.background(|out| match photographs.windows.count {
            1 => Ok(FittedPart::default()),
            _ => background(&plan.fit, photographs, again(runtime), out, on_fit),
        })
    }

    /// Fits a part; returns its photographs.
    fn part(
        &mut self,
        mut claim: Claim,
        background: &Parameters<f32>,
        in_memory: Loaded,
        next: Option<usize>,
        on_fit: &mut dyn FnMut(&FitProgress),
    ) -> anyhow::Result<Loaded> {
        let Process { plan, runtime, work, without_anchor, .. } = self;
        let photographs = self.photographs;
        let begun = Instant::now();
        let part = claim.part;
        let views = photographs.views(part, in_memory)?;
        let beside = std::mem::take(&mut claim.beside);
        let is_finished = is_finished(&beside);
        let mut passed_on = Parameters::default();
        let start = |backend: &mut dyn Backend| {
            Ok(match part::start(&plan.fit, photographs, part, &views, background, beside, backend)? {
                Start::Fit(fit) => Some(*fit),
                Start::Nothing { carried, why } => {
                    passed_on = *carried;
                    *without_anchor = without_anchor.take().or(why);
                    None
                }
            })
        };
        let fitted = thread::scope(|scope| {
            if let Some(next) = next {
                scope.spawn(move || photographs.read_ahead(next, part));
            }
            fit_from(&plan.fit, photographs.capture_files, &views, again(runtime), &claim.out, on_fit, start)
        })?;
        let device = fitted.as_ref().and_then(Fitted::device);
        let fitted = fitted.map_or(passed_on, |fitted| fitted.fit.into_fitted());
        let seconds = begun.elapsed().as_secs_f64();
        let fitted = FittedPart { seconds, device, ..divided(&fitted, photographs, part, is_finished) };
        work.complete(claim, &fitted)?;
        Ok(views.train)
    }
}

/// The runtime for one more fit.
fn again<'a>(runtime: &'a mut FitRuntime) -> FitRuntime<'a> {
    FitRuntime { backend: &mut *runtime.backend, ..*runtime }
}
