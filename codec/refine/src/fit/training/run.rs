//! [`Run`]: the optimisation loop, step by step.

use super::Fit;
use crate::fit::backend::{Backend, DeviceError, StepConfig, StepReport};
use crate::fit::cameras::{SeenView, respond};
use crate::fit::density::DensityChange;
use crate::fit::loss::Lpips;
use crate::fit::optimizer::decay;
use crate::fit::views::{FrameView, RenderedImage, TrainingView};

/// Photographs that cameras have yet to learn from while the next one is taken: as many steps may be in flight on a device.
const LESSONS: usize = 2;

/// A fit in progress: a back end owns its training state.
pub struct Run<'a> {
    fit: Fit,
    backend: &'a mut dyn Backend,
    /// Number of Gaussians.
    count: usize,
    change: DensityChange,
    /// Number of steps that have begun and not ended.
    in_flight: usize,
}

impl<'a> Run<'a> {
    /// Starts or continues `fit` on `backend`.
    ///
    /// # Errors
    /// A [`DeviceError`] if the Gaussians do not fit on the device.
    pub fn start(mut fit: Fit, backend: &'a mut dyn Backend) -> Result<Run<'a>, DeviceError> {
        let count = fit.len();
        backend.load(fit.take())?;
        Ok(Run { fit, backend, count, change: DensityChange::default(), in_flight: 0 })
    }

    /// Takes one step, on one of `views`. The order is a random permutation per epoch. A back end may still compute the step
    /// when this returns. Returns the reports of the steps that ended meanwhile, in order.
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
    ) -> Result<Vec<StepReport>, DeviceError> {
        self.begin(views, lpips)?;
        let fit = &mut self.fit;
        fit.steps_done += 1;
        let is_control_due = fit.is_control_due(self.count);
        let (is_thinning_due, is_keeping_due) = (fit.is_thinning_due(), fit.is_keeping_due());
        let is_any_due = is_control_due || is_thinning_due || is_keeping_due;
        let is_done = fit.is_done();
        let in_flight = self.backend.in_flight().min(LESSONS);
        let reports = self.end_but(if is_any_due || is_done { 0 } else { in_flight })?;
        let fit = &mut self.fit;
        // Cameras learn equally late on every back end, however early a step has ended.
        if let Some(rig) = &mut fit.rig {
            fit.non_finite += rig.learn_but(if is_done { 0 } else { LESSONS }, fit.bounds.extent);
        }
        self.change = DensityChange::default();
        if is_any_due {
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
        Ok(reports)
    }

    fn begin(&mut self, views: &[&TrainingView], lpips: Option<&Lpips<f32>>) -> Result<(), DeviceError> {
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
        self.backend.begin_step(&frame_view, &view.photograph, &config)?;
        self.in_flight += 1;
        if let Some(rig) = &mut fit.rig {
            rig.begin(view.camera_id, place, factor);
        }
        Ok(())
    }

    /// Ends all steps but the last `rest`.
    fn end_but(&mut self, rest: usize) -> Result<Vec<StepReport>, DeviceError> {
        let mut reports = Vec::new();
        while self.in_flight > rest {
            let report = self.backend.end_step()?;
            self.in_flight -= 1;
            self.fit.non_finite += report.non_finite as u64;
            if let (Some(rig), Some(by_camera)) = (&mut self.fit.rig, report.camera) {
                rig.end(by_camera);
            }
            reports.push(report);
        }
        Ok(reports)
    }

    /// Waits until all steps have ended. Returns the reports of those that had not, in order.
    ///
    /// # Errors
    /// A [`DeviceError`]; the run is then over.
    pub fn settle(&mut self) -> Result<Vec<StepReport>, DeviceError> {
        self.end_but(0)
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
        self.end_but(0)?;
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
    use crate::capture::Response;
    use crate::fit::fixtures::{TIMELINE, camera, cloud};
    use crate::fit::{Cpu, FitSettings, Learned, Parameters, Photograph, Rig};

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
    fn a_fit_that_was_paused_learns_its_cameras_as_one_that_was_not() {
        let camera = camera(16, 16);
        let view = |camera_id: usize| {
            let pixels = vec![[90, 60, 200 - 90 * camera_id as u8, 255]; 256];
            let photograph = Photograph { width: 16, height: 16, pixels, valid: Vec::new() };
            TrainingView { camera_id, camera: camera.clone(), time: 4.0, photograph }
        };
        let views = [view(0), view(1)];
        let all: Vec<&TrainingView> = views.iter().collect();
        let settings = FitSettings { steps: 10, floor: 0, ..FitSettings::default() };
        let learned = Learned { colors: true, exposures: true, ..Learned::default() };
        let parameters = Parameters::from_field(&cloud(5, 50, 0), TIMELINE);
        let fit = Fit::new(settings, parameters, TIMELINE, [&camera; 2]);
        let fit = fit.seen_by(Rig::new(learned, vec![Response::NEUTRAL; 2], 0));
        let mut backend = Cpu::default();
        let mut ended = |pauses: &[u64]| {
            let mut fit = fit.clone();
            for end in pauses.iter().copied().chain([10]) {
                let mut run = Run::start(fit, &mut backend).unwrap();
                while run.steps_done() < end {
                    run.step(&all, None).unwrap();
                }
                fit = run.pause().unwrap();
                assert!(fit.is_consistent());
            }
            fit
        };
        let whole = ended(&[]);
        let [a, b] = [0, 1].map(|camera| whole.rig().unwrap().response(camera));
        assert!(a != b, "they learn");
        assert!(ended(&[1, 2, 5, 9]) == whole, "bit by bit");
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
