//! [`Run`]: the optimisation loop, step by step.

use super::Fit;
use crate::fit::backend::{Backend, DeviceError, StepConfig, StepReport};
use crate::fit::cameras::{SeenView, respond};
use crate::fit::density::DensityChange;
use crate::fit::loss::Lpips;
use crate::fit::optimizer::decay;
use crate::fit::views::{FrameView, RenderedImage, TrainingView};

/// A fit in progress: a back end owns its training state.
pub struct Run<'a> {
    fit: Fit,
    backend: &'a mut dyn Backend,
    /// Number of Gaussians.
    count: usize,
    change: DensityChange,
}

impl<'a> Run<'a> {
    /// Starts or continues `fit` on `backend`.
    ///
    /// # Errors
    /// A [`DeviceError`] if the Gaussians do not fit on the device.
    pub fn start(mut fit: Fit, backend: &'a mut dyn Backend) -> Result<Run<'a>, DeviceError> {
        let count = fit.len();
        backend.load(fit.take())?;
        Ok(Run { fit, backend, count, change: DensityChange::default() })
    }

    /// Takes one step, on one of `views`. The order is a random permutation per epoch.
    ///
    /// # Errors
    /// A [`DeviceError`]; the run is then over.
    ///
    /// # Panics
    /// If `views` is empty.
    pub fn step(
        &mut self,
        views: &[&TrainingView],
        lpips: Option<&Lpips<f32>>,
    ) -> Result<StepReport, DeviceError> {
        let fit = &mut self.fit;
        let place = shuffled(fit.steps_done, views.len(), fit.settings.seed);
        let view = views[place];
        let seen = fit.rig.as_ref().map(|rig| rig.seen(view, Some(place)));
        let factor = decay(fit.steps_done as usize, fit.settings.steps as usize);
        let config = StepConfig {
            rates: fit.rates.scaled(factor),
            bounds: fit.bounds,
            detach_tau: fit.settings.detach_tau,
            fragment_weight: fit.settings.fragment_weight / fit.bounds.extent.powi(2),
            response: seen.as_ref().map(|seen| seen.response),
            lpips,
        };
        let frame_view = seen.as_ref().map_or(view.view(), SeenView::view);
        let report = self.backend.step(&frame_view, &view.photograph, &config)?;
        fit.non_finite += report.non_finite as u64;
        if let (Some(rig), Some(by_camera)) = (&mut fit.rig, &report.camera) {
            let is_finite = rig.learn(view.camera_id, place, by_camera, factor, fit.bounds.extent);
            fit.non_finite += u64::from(!is_finite);
        }
        fit.steps_done += 1;
        self.change = DensityChange::default();
        let is_control_due = fit.is_control_due(self.count);
        let (is_thinning_due, is_keeping_due) = (fit.is_thinning_due(), fit.is_keeping_due());
        if is_control_due || is_thinning_due || is_keeping_due {
            fit.put(self.backend.store()?);
            if is_control_due {
                self.change = fit.control();
            } else if is_thinning_due {
                self.change.pruned = fit.thin(views);
            }
            if is_keeping_due {
                fit.keep_limits();
            }
            self.count = fit.len();
            self.backend.load(fit.take())?;
        }
        Ok(report)
    }

    /// Result of the capacity control or the thinning after the last step; zeros if none was due.
    pub fn density_change(&self) -> DensityChange {
        self.change
    }

    /// Renders from the viewpoint of `view`, as its camera shows it.
    ///
    /// # Errors
    /// A [`DeviceError`].
    pub fn render(&mut self, view: &TrainingView) -> Result<RenderedImage<f32>, DeviceError> {
        let Some(SeenView { camera, time, response }) = self.fit.rig.as_ref().map(|rig| rig.seen(view, None))
        else {
            return self.backend.render(&view.view());
        };
        let image = self.backend.render(&FrameView { camera: &camera, time })?;
        Ok(RenderedImage { pixels: respond(&image, &response), ..image })
    }

    /// Takes the fit back from the back end.
    ///
    /// # Errors
    /// A [`DeviceError`]; the steps since the run started are then lost.
    pub fn pause(mut self) -> Result<Fit, DeviceError> {
        self.fit.put(self.backend.store()?);
        Ok(self.fit)
    }

    /// Name of the back end.
    pub fn backend(&self) -> String {
        self.backend.name()
    }

    /// Number of steps done.
    pub fn steps_done(&self) -> u64 {
        self.fit.steps_done()
    }

    /// Whether all steps are done.
    pub fn is_done(&self) -> bool {
        self.fit.is_done()
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

/// Index in `0..count` for `step`: a random permutation per epoch of `count` steps.
fn shuffled(step: u64, count: usize, seed: u64) -> usize {
    let (epoch, place) = (step / count as u64, (step % count as u64) as usize);
    let mut order: Vec<usize> = (0..count).collect();
    fastrand::Rng::with_seed(seed ^ epoch.wrapping_mul(0x9e37_79b9_7f4a_7c15)).shuffle(&mut order);
    order[place]
}

#[cfg(test)]
mod tests {
    use codec::Field;

    use super::*;
    use crate::fit::fixtures::{TIMELINE, camera, cloud};
    use crate::fit::{Cpu, FitSettings, Parameters, Photograph};

    #[test]
    fn still_gaussians_are_thinned_once_when_densification_ends() {
        let still = Field { temporal: None, ..cloud(5, 200, 0) };
        let camera = camera(32, 32);
        let photograph =
            Photograph { width: 32, height: 32, pixels: vec![[90, 90, 90, 255]; 1024], valid: Vec::new() };
        let view = TrainingView { camera_id: 0, camera, time: 4.0, photograph };
        let mut backend = Cpu::default();
        // Gaussians pruned in each step.
        let mut pruned = |thins: bool| -> Vec<usize> {
            let settings = FitSettings { steps: 10, floor: 0, thins, ..FitSettings::default() };
            let parameters = Parameters::from_field(&still, TIMELINE);
            let fit = Fit::new(settings, parameters, TIMELINE, [&view.camera]);
            let mut run = Run::start(fit, &mut backend).unwrap();
            let step = |_| {
                run.step(&[&view], None).unwrap();
                run.density_change().pruned
            };
            let pruned: Vec<usize> = (0..10).map(step).collect();
            let fit = run.pause().unwrap();
            assert!(fit.len() == 200 - pruned.iter().sum::<usize>() && fit.is_consistent());
            pruned
        };
        let with = pruned(true);
        assert!((40..110).contains(&with[3]) && with.iter().sum::<usize>() == with[3], "{with:?}");
        assert_eq!(pruned(false), [0; 10]);
    }

    #[test]
    fn an_epoch_visits_every_view_once() {
        let epoch = |epoch: u64| -> Vec<usize> { (0..7).map(|i| shuffled(7 * epoch + i, 7, 3)).collect() };
        for i in 0..5 {
            let mut sorted = epoch(i);
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3, 4, 5, 6]);
        }
        assert_ne!(epoch(0), epoch(1), "in another order");
    }
}
