//! [`Gpu`]: the back end that runs on a graphics device.

use std::collections::VecDeque;

use shaders::fit::layout::Statistics;

use super::buffers::{Buffers, Fixed, IN_FLIGHT, Pairs, PerGaussian, PerPixel};
use super::device::{Device, DeviceCounts};
use super::kernels::Kernels;
use super::plan::Plan;
use super::steps::Loaded;
use super::timer::Timer;
use super::transfer;
use crate::fit::backend::{
    Backend, DeviceError, Gradient, PixelGradients, StepConfig, StepReport, TrainingState,
};
use crate::fit::views::{FrameView, Photograph, RenderedImage};

/// Initial capacity for splat-tile pairs.
const FIRST_PAIRS: u32 = 1 << 14;

/// A graphics device.
pub struct Gpu {
    device: Device,
    loaded: Option<Loaded>,
    /// For the next training state.
    timer: Option<Timer>,
}

impl Gpu {
    /// Opens the fastest device of the machine.
    ///
    /// # Errors
    /// [`DeviceError::Missing`] if there is none, or none that is capable enough.
    pub fn open() -> Result<Gpu, DeviceError> {
        Ok(Gpu { device: Device::open()?, loaded: None, timer: None })
    }

    /// Whether the device is a software driver, that is the CPU.
    pub fn is_software(&self) -> bool {
        self.device.is_software
    }

    /// What the device was asked to do since it was opened.
    pub fn counts(&self) -> DeviceCounts {
        self.device.counts()
    }

    /// Bytes that the device copies from one buffer to another in a millisecond, both directions counted.
    ///
    /// # Errors
    /// A [`DeviceError`].
    pub fn copied_bytes_a_ms(&self) -> Result<f64, DeviceError> {
        self.device.copied_bytes_a_ms()
    }

    /// Bytes of the parameters of a loaded Gaussian.
    ///
    /// # Panics
    /// If nothing is loaded.
    pub fn gaussian_bytes(&self) -> u64 {
        let loaded = self.loaded.as_ref().expect("Gaussians were loaded");
        4 * u64::from(loaded.kernels.columns.numbers())
    }

    /// Times the parts of each step from the next [`load`](Backend::load) on; a step then begins when the one before has ended.
    /// Nothing happens on a device without timestamps.
    ///
    /// # Errors
    /// A [`DeviceError`].
    pub fn time_parts(&mut self) -> Result<(), DeviceError> {
        self.timer = Timer::new(&self.device)?;
        Ok(())
    }

    /// The parts of a step and the milliseconds that they took so far; empty if they are not timed.
    pub fn part_times(&self) -> Vec<(&'static str, f64)> {
        let timer = self.loaded.as_ref().and_then(|loaded| loaded.timer.as_ref());
        timer.map_or_else(Vec::new, |timer| timer.parts().to_vec())
    }

    /// Renders the loaded Gaussians and backpropagates `d_image`, the gradient of a loss with respect to
    /// the pixels. For `detach_tau` see [`FitSettings`](crate::fit::FitSettings::detach_tau).
    ///
    /// # Errors
    /// A [`DeviceError`].
    ///
    /// # Panics
    /// If nothing is loaded, or if `d_image` and the image differ in length.
    pub fn gradient(
        &mut self,
        view: &FrameView,
        d_image: &[[f32; 4]],
        detach_tau: bool,
    ) -> Result<Gradient<f32>, DeviceError> {
        let (device, loaded) = self.loaded();
        let size = [view.camera.width, view.camera.height];
        assert_eq!(d_image.len() as u64, pixels(size), "a gradient for each pixel");
        loaded.resize(device, size)?;
        loaded.settle(device)?;
        let before: Vec<Statistics> = device.read(&loaded.buffers.gaussians.statistics, loaded.count())?;
        let mut inputs = transfer::inputs(view, loaded.shape.near, detach_tau);
        inputs.uniforms.learns_camera = 1;
        let results = loaded.run(
            device,
            &inputs,
            |device, loaded| device.write(&loaded.buffers.pixels.d_image, 0, d_image),
            |plan| [&plan.forward, &plan.backward],
        )?;
        let Buffers { gaussians, .. } = &loaded.buffers;
        let drawn = results.totals.drawn as usize;
        let values =
            transfer::rows_of(device, &gaussians.d_parameters, &loaded.shape, drawn, loaded.count())?;
        let order: Vec<u32> = device.read(loaded.buffers.order(), drawn)?;
        let after: Vec<Statistics> = device.read(&gaussians.statistics, loaded.count())?;
        device.write(&gaussians.statistics, 0, &before);
        let mut places: Vec<usize> = (0..drawn).collect();
        places.sort_unstable_by_key(|place| order[*place]);
        let rows: Vec<u32> = places.iter().map(|place| order[*place]).collect();
        let screen = |row: &u32| after[*row as usize].screen_gradient - before[*row as usize].screen_gradient;
        Ok(Gradient {
            values: values.select(&places),
            screen: rows.iter().map(screen).collect(),
            rows,
            view: results.by_view(),
            non_finite: results.totals.non_finite as usize,
        })
    }

    fn loaded(&mut self) -> (&Device, &mut Loaded) {
        (&self.device, self.loaded.as_mut().expect("Gaussians were loaded"))
    }
}

impl Backend for Gpu {
    fn device(&self) -> Option<&str> {
        Some(&self.device.name)
    }

    fn in_flight(&self) -> usize {
        let is_timed = self.loaded.as_ref().is_some_and(|loaded| loaded.timer.is_some());
        if is_timed { 0 } else { IN_FLIGHT }
    }

    fn load(&mut self, state: TrainingState) -> Result<(), DeviceError> {
        // What has not ended is dropped, and its buffers with it.
        let mut before = self.loaded.take().filter(|loaded| loaded.in_flight.is_empty());
        let timer = self.timer.take().or_else(|| before.as_mut()?.timer.take());
        let columns = transfer::columns_of(&state.parameters);
        let device = &self.device;
        let count = u32::try_from(state.parameters.len()).unwrap_or(u32::MAX);
        // Reuses kernels and buffers of the previous state; the rest is freed first.
        let (kernels, buffers) = match before {
            Some(Loaded { kernels, buffers, .. }) if kernels.columns == columns => (kernels, Some(buffers)),
            _ => (Kernels::new(device, columns), None),
        };
        let buffers = match buffers {
            Some(buffers) if buffers.gaussians.count == count => buffers,
            Some(Buffers { fixed, pixels, pairs, gaussians }) => {
                drop(gaussians);
                Buffers { fixed, pixels, pairs, gaussians: PerGaussian::new(device, count, columns)? }
            }
            None => Buffers {
                fixed: Fixed::new(device)?,
                pixels: PerPixel::new(device, [1, 1], None)?,
                gaussians: PerGaussian::new(device, count, columns)?,
                pairs: Pairs::new(device, FIRST_PAIRS)?,
            },
        };
        transfer::upload(device, &buffers.gaussians, &state);
        let plan = Plan::new(device, &kernels, &buffers)?;
        let (shape, carried) = (state.parameters.zeros(1), state.moments.carried);
        let (in_flight, reports) = (VecDeque::new(), VecDeque::new());
        self.loaded =
            Some(Loaded { shape, carried, kernels, buffers, plan, in_flight, turn: 0, reports, timer });
        Ok(())
    }

    fn render(&mut self, view: &FrameView) -> Result<RenderedImage<f32>, DeviceError> {
        let (device, loaded) = self.loaded();
        let size = [view.camera.width, view.camera.height];
        loaded.resize(device, size)?;
        let inputs = transfer::inputs(view, loaded.shape.near, true);
        loaded.run(device, &inputs, |_, _| (), |plan| [&plan.forward])?;
        loaded.image(device, size)
    }

    fn render_each(
        &mut self,
        views: &[FrameView],
        take: &mut dyn FnMut(RenderedImage<f32>),
    ) -> Result<(), DeviceError> {
        views.iter().try_for_each(|view| self.render(view).map(&mut *take))
    }

    fn gradients(
        &mut self,
        views: &[FrameView],
        of_pixels: &PixelGradients,
        take: &mut dyn FnMut(Vec<Gradient<f32>>),
    ) -> Result<(), DeviceError> {
        for (i, view) in views.iter().enumerate() {
            let d_images = of_pixels(i, &self.render(view)?.pixels);
            let gradients = d_images.iter().map(|d_image| self.gradient(view, d_image, false));
            take(gradients.collect::<Result<_, _>>()?);
        }
        Ok(())
    }

    fn begin_step(
        &mut self,
        view: &FrameView,
        photograph: &Photograph,
        config: &StepConfig,
    ) -> Result<(), DeviceError> {
        let (device, loaded) = self.loaded();
        let size = [view.camera.width, view.camera.height];
        assert_eq!(photograph.pixels.len() as u64, pixels(size), "a photograph of the camera's size");
        assert!(loaded.in_flight.len() + loaded.reports.len() <= IN_FLIGHT, "steps end");
        loaded.resize(device, size)?;
        let inputs = transfer::step_inputs(view, loaded.shape.near, photograph, config);
        match config.lpips {
            None => {
                let turn = loaded.next_turn();
                device.write(&loaded.buffers.pixels.photographs[turn], 0, &photograph.words());
                loaded.begin(device, inputs, turn);
                Ok(())
            }
            Some(lpips) => loaded.step_with_lpips(device, &inputs, photograph, config, lpips),
        }
    }

    fn end_step(&mut self) -> Result<StepReport, DeviceError> {
        let (device, loaded) = self.loaded();
        if loaded.reports.is_empty() {
            loaded.end(device)?;
        }
        Ok(loaded.reports.pop_front().expect("a step has begun"))
    }

    fn store(&mut self) -> Result<TrainingState, DeviceError> {
        let (device, loaded) = self.loaded();
        loaded.settle(device)?;
        transfer::download(device, &loaded.buffers.gaussians, &loaded.shape, loaded.carried.clone())
    }

    fn peak_device_bytes(&self) -> Option<u64> {
        Some(self.device.peak_bytes())
    }
}

fn pixels(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1])
}

#[cfg(test)]
mod tests {
    use crate::fit::loss::LAMBDA;
    use crate::fit::optimizer::{BETA1, BETA2, EPSILON, REACH_MIN, SUPPORT_RADIUS};
    use crate::fit::parameters::NORM_MIN;
    use crate::raster::{ALPHA_MAX, TRANSMITTANCE_MIN};

    #[test]
    fn shaders_have_the_constants_of_the_cpu() {
        assert_eq!(shaders::fit::ADAM, [BETA1, BETA2, EPSILON].map(|x| x as f32));
        assert_eq!(shaders::fit::REACH, [SUPPORT_RADIUS, REACH_MIN].map(|x| x as f32));
        assert_eq!(shaders::fit::LAMBDA, LAMBDA as f32);
        let raster = [shaders::ALPHA_MIN, shaders::ALPHA_MAX, shaders::fit::TRANSMITTANCE_MIN];
        assert_eq!(raster, [codec::ALPHA_MIN, ALPHA_MAX, TRANSMITTANCE_MIN].map(|x| x as f32));
        assert_eq!(shaders::fit::LENGTH_MIN, NORM_MIN as f32);
        assert_eq!(shaders::FADE_START, codec::FADE_START as f32);
        for filter in codec::PixelFilter::ALL {
            assert_eq!(shaders::filter_variance(filter.compensates()), filter.variance() as f32);
        }
    }
}
