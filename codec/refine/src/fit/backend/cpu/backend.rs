//! [`Cpu`]: the back end that runs on all cores.

use super::render::render;
use crate::fit::backend::{
    Backend, DeviceError, Gradient, PixelGradients, StepConfig, StepReport, TrainingState,
};
use crate::fit::cameras::{respond, respond_backward};
use crate::fit::loss::loss;
use crate::fit::optimizer::{adam, add_fragment_term};
use crate::fit::views::{FrameView, Photograph, RenderedImage};
use crate::in_order::for_each_in_order;

/// The cores of the machine. Results are the same bit by bit for any number of them.
#[derive(Clone, Debug, Default)]
pub struct Cpu {
    loaded: Option<TrainingState>,
    /// The report of the step that has begun, until it ends.
    report: Option<StepReport>,
}

impl Cpu {
    fn loaded(&mut self) -> &mut TrainingState {
        self.loaded.as_mut().expect("Gaussians were loaded")
    }
}

impl Backend for Cpu {
    fn device(&self) -> Option<&str> {
        None
    }

    fn in_flight(&self) -> usize {
        0
    }

    fn load(&mut self, state: TrainingState) -> Result<(), DeviceError> {
        (self.loaded, self.report) = (Some(state), None);
        Ok(())
    }

    fn render(&mut self, view: &FrameView) -> Result<RenderedImage<f32>, DeviceError> {
        Ok(render(&self.loaded().parameters, view).image)
    }

    fn render_each(
        &mut self,
        views: &[FrameView],
        take: &mut dyn FnMut(RenderedImage<f32>),
    ) -> Result<(), DeviceError> {
        let parameters = &self.loaded().parameters;
        for_each_in_order(views, |view| render(parameters, view).image, |_, image| take(image));
        Ok(())
    }

    fn gradients(
        &mut self,
        views: &[FrameView],
        of_pixels: &PixelGradients,
        take: &mut dyn FnMut(Vec<Gradient<f32>>),
    ) -> Result<(), DeviceError> {
        let parameters = &self.loaded().parameters;
        let backward = |(i, view): &(usize, &FrameView)| {
            let forward = render(parameters, view);
            let d_images = of_pixels(*i, &forward.image.pixels);
            d_images.iter().map(|d_image| forward.backward(parameters, view, d_image, false)).collect()
        };
        let numbered: Vec<(usize, &FrameView)> = views.iter().enumerate().collect();
        for_each_in_order(&numbered, backward, |_, gradients| take(gradients));
        Ok(())
    }

    fn begin_step(
        &mut self,
        view: &FrameView,
        photograph: &Photograph,
        config: &StepConfig,
    ) -> Result<(), DeviceError> {
        assert!(self.report.is_none(), "the step before has ended");
        let TrainingState { parameters, moments, screen_gradients } = self.loaded();
        let forward = render(parameters, view);
        let seen = config.response.map(|response| respond(&forward.image, &response));
        let pixels = seen.as_ref().unwrap_or(&forward.image.pixels);
        let mut loss = loss(pixels, photograph, config.lpips);
        let by_response =
            config.response.map(|response| respond_backward(&forward.image, &response, &mut loss.gradient));
        let Gradient { rows, mut values, screen, view: by_view, non_finite } =
            forward.backward(parameters, view, &loss.gradient, config.detach_tau);
        add_fragment_term(&mut values, parameters, &rows, config.fragment_weight);
        let skipped = adam(parameters, moments, &rows, &values, &config.rates, &config.bounds);
        screen_gradients.accumulate(&rows, &screen);
        self.report = Some(StepReport {
            loss: loss.value,
            drawn: rows.len(),
            non_finite: non_finite + skipped,
            camera: by_response.map(|by_response| by_view.numbers(&by_response)),
        });
        Ok(())
    }

    fn end_step(&mut self) -> Result<StepReport, DeviceError> {
        Ok(self.report.take().expect("a step has begun"))
    }

    fn store(&mut self) -> Result<TrainingState, DeviceError> {
        Ok(self.loaded.take().expect("Gaussians were loaded"))
    }

    fn peak_device_bytes(&self) -> Option<u64> {
        None
    }
}
