//! [`Gpu`]: the back end that runs on a graphics device.

use shaders::fit::layout::{Statistics, Totals};
use shaders::fit::{CAMERA_NUMBERS, Columns};

use super::buffers::{Buffers, Fixed, Pairs, PerGaussian, PerPixel, Scanned};
use super::device::Device;
use super::kernels::{Dispatch, Kernels};
use super::plan::Plan;
use super::transfer;
use crate::capture::Response;
use crate::fit::backend::{
    Backend, DeviceError, Gradient, PixelGradients, StepConfig, StepReport, TrainingState,
};
use crate::fit::cameras::{RESPONSE_NUMBERS, ViewGradient};
use crate::fit::loss::{LAMBDA, alpha_channels, lpips_loss};
use crate::fit::parameters::{Carried, Parameters};
use crate::fit::views::{FrameView, Photograph, RenderedImage};

/// Initial capacity for splat-tile pairs.
const FIRST_PAIRS: u32 = 1 << 14;

/// A graphics device.
pub struct Gpu {
    device: Device,
    loaded: Option<Loaded>,
}

/// A training state on the device, with all that a step needs.
struct Loaded {
    /// A row of zeros with the columns of the parameters.
    shape: Parameters<f32>,
    /// The past of the rows, which the device does not change.
    carried: Vec<Carried>,
    kernels: Kernels,
    buffers: Buffers,
    plan: Plan,
}

impl Gpu {
    /// Opens the fastest device of the machine.
    ///
    /// # Errors
    /// [`DeviceError::Missing`] if there is none, or none that is capable enough.
    pub fn open() -> Result<Gpu, DeviceError> {
        Ok(Gpu { device: Device::open()?, loaded: None })
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
        loaded.learn_cameras(device)?;
        device.write(&loaded.buffers.fixed.response, 0, &[transfer::response(&Response::NEUTRAL)]);
        assert_eq!(d_image.len() as u64, pixels(size), "a gradient for each pixel");
        loaded.resize(device, size)?;
        let before: Vec<Statistics> = device.read(&loaded.buffers.gaussians.statistics, loaded.count())?;
        let totals = loaded.run(device, view, detach_tau, 0.0, |device, loaded| {
            device.write(&loaded.buffers.pixels.d_image, 0, d_image);
            let stages = [&loaded.plan.forward[..], &loaded.plan.backward];
            loaded.submit(device, size, &stages, device.encoder())
        })?;
        let Buffers { gaussians, .. } = &loaded.buffers;
        let drawn = totals.drawn as usize;
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
            view: loaded.d_camera(device)?.0,
            non_finite: totals.non_finite as usize,
        })
    }

    fn loaded(&mut self) -> (&Device, &mut Loaded) {
        (&self.device, self.loaded.as_mut().expect("Gaussians were loaded"))
    }
}

impl Backend for Gpu {
    fn name(&self) -> String {
        format!("gpu, {}", self.device.name)
    }

    fn load(&mut self, state: TrainingState) -> Result<(), DeviceError> {
        let learns_cameras = self.loaded.as_ref().is_some_and(|loaded| loaded.kernels.columns.learns_cameras);
        let columns = transfer::columns_of(&state.parameters, learns_cameras);
        let device = &self.device;
        let count = u32::try_from(state.parameters.len()).unwrap_or(u32::MAX);
        // Reuses kernels and buffers of the previous state; the rest is freed first.
        let (kernels, buffers) = match self.loaded.take() {
            Some(Loaded { kernels, buffers, .. }) if kernels.columns == columns => (kernels, Some(buffers)),
            _ => (Kernels::new(device, columns), None),
        };
        let buffers = match buffers {
            Some(buffers) if buffers.gaussians.count == count => buffers,
            Some(Buffers { fixed, pixels, pairs, gaussians, scanned }) => {
                drop((gaussians, scanned));
                Buffers {
                    fixed,
                    pixels,
                    gaussians: PerGaussian::new(device, count, columns)?,
                    scanned: Scanned::new(device, pairs.capacity.max(count))?,
                    pairs,
                }
            }
            None => Buffers {
                fixed: Fixed::new(device)?,
                pixels: PerPixel::new(device, [1, 1], learns_cameras, None)?,
                gaussians: PerGaussian::new(device, count, columns)?,
                scanned: Scanned::new(device, FIRST_PAIRS.max(count))?,
                pairs: Pairs::new(device, FIRST_PAIRS)?,
            },
        };
        transfer::upload(device, &buffers.gaussians, &state);
        let plan = Plan::new(device, &kernels, &buffers)?;
        let (shape, carried) = (state.parameters.zeros(1), state.moments.carried);
        self.loaded = Some(Loaded { shape, carried, kernels, buffers, plan });
        Ok(())
    }

    fn render(&mut self, view: &FrameView) -> Result<RenderedImage<f32>, DeviceError> {
        let (device, loaded) = self.loaded();
        let (width, height) = (view.camera.width, view.camera.height);
        loaded.resize(device, [width, height])?;
        loaded.run(device, view, true, 0.0, |device, loaded| {
            loaded.submit(device, [width, height], &[&loaded.plan.forward], device.encoder())
        })?;
        let pixels = device.read(&loaded.buffers.pixels.image, width as usize * height as usize)?;
        Ok(RenderedImage { width, height, pixels })
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

    fn step(
        &mut self,
        view: &FrameView,
        photograph: &Photograph,
        config: &StepConfig,
    ) -> Result<StepReport, DeviceError> {
        let (device, loaded) = self.loaded();
        let size = [view.camera.width, view.camera.height];
        assert_eq!(photograph.pixels.len() as u64, pixels(size), "a photograph of the camera's size");
        if config.response.is_some() {
            loaded.learn_cameras(device)?;
        }
        // Once cameras are learned, the kernels apply a response in every step.
        let response = config.response.as_ref().unwrap_or(&Response::NEUTRAL);
        device.write(&loaded.buffers.fixed.response, 0, &[transfer::response(response)]);
        loaded.resize(device, size)?;
        device.write(&loaded.buffers.pixels.photograph, 0, &photograph.words());
        device.write(&loaded.buffers.fixed.adam_uniforms, 0, &[transfer::adam_uniforms(config)]);
        let mut perceptual = 0.0;
        let totals =
            loaded.run(device, view, config.detach_tau, alpha_channels(photograph), |device, loaded| {
                let Plan { forward, respond, loss, backward, adam } = &loaded.plan;
                let after = [&loss[..], backward, std::slice::from_ref(adam)];
                let mut encoder = device.encoder();
                let Some(lpips) = config.lpips else {
                    encoder.clear_buffer(&loaded.buffers.pixels.d_image.raw, 0, None);
                    let stages = [&forward[..], respond, after[0], after[1], after[2]];
                    return loaded.submit(device, size, &stages, encoder);
                };
                let totals = loaded.submit(device, size, &[forward, respond], encoder)?;
                if !loaded.pairs_fit(&totals) {
                    return Ok(totals);
                }
                let term = lpips_loss(&loaded.seen(device, size)?, photograph, lpips);
                perceptual = term.value;
                device.write(&loaded.buffers.pixels.d_image, 0, &term.gradient);
                loaded.submit(device, size, &after, device.encoder())
            })?;
        let channels = (3 * photograph.pixels.len()).max(1) as f64;
        let [absolute, similarity] =
            [totals.absolute, totals.similarity].map(|sum| f64::from(sum) / channels);
        let camera = match config.response {
            Some(_) => {
                let (by_view, by_response) = loaded.d_camera(device)?;
                Some(by_view.numbers(&by_response))
            }
            None => None,
        };
        Ok(StepReport {
            camera,
            loss: (1.0 - LAMBDA) * absolute + LAMBDA * (1.0 - similarity) + perceptual,
            drawn: totals.drawn as usize,
            non_finite: totals.non_finite as usize,
        })
    }

    fn store(&mut self) -> Result<TrainingState, DeviceError> {
        let (device, loaded) = self.loaded();
        transfer::download(device, &loaded.buffers.gaussians, &loaded.shape, loaded.carried.clone())
    }

    fn peak_device_bytes(&self) -> Option<u64> {
        Some(self.device.peak_bytes())
    }
}

impl Loaded {
    fn count(&self) -> usize {
        self.buffers.gaussians.count as usize
    }

    /// Grows the buffers for images of `size`.
    fn resize(&mut self, device: &Device, size: [u32; 2]) -> Result<(), DeviceError> {
        if !self.buffers.pixels.fits(size) {
            let learns_cameras = self.kernels.columns.learns_cameras;
            self.buffers.pixels = PerPixel::new(device, size, learns_cameras, Some(&self.buffers.pixels))?;
            self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        }
        Ok(())
    }

    /// Compiles the kernels that show the image as a camera does and leave the gradient with respect to the camera, and
    /// allocates their buffers, if that has not been done.
    fn learn_cameras(&mut self, device: &Device) -> Result<(), DeviceError> {
        let Columns { learns_cameras, .. } = self.kernels.columns;
        if learns_cameras {
            return Ok(());
        }
        self.kernels = Kernels::new(device, Columns { learns_cameras: true, ..self.kernels.columns });
        let Buffers { gaussians, pixels, .. } = &mut self.buffers;
        gaussians.columns = self.kernels.columns;
        gaussians.d_view = PerGaussian::d_view(device, gaussians.count, gaussians.columns)?;
        pixels.seen = PerPixel::seen(device, pixels.pixels, true)?;
        self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        Ok(())
    }

    /// The gradient of the last step with respect to the view and to the response.
    fn d_camera(&self, device: &Device) -> Result<(ViewGradient<f32>, [f64; RESPONSE_NUMBERS]), DeviceError> {
        let numbers: Vec<f32> = device.read(&self.buffers.fixed.d_camera, CAMERA_NUMBERS)?;
        let view = ViewGradient {
            time: numbers[0],
            rotation: [numbers[1], numbers[2], numbers[3]],
            translation: [numbers[4], numbers[5], numbers[6]],
            log_focal: numbers[7],
        };
        Ok((view, std::array::from_fn(|i| f64::from(numbers[8 + i]))))
    }

    /// Whether the buffers held all pairs. A count that overflowed is saturated.
    fn pairs_fit(&self, totals: &Totals) -> bool {
        totals.pairs <= self.buffers.pairs.capacity && totals.pairs != u32::MAX
    }

    /// Runs `attempt`, again with larger buffers until all pairs fit. Alpha counts in its loss, if it has one, as
    /// `alpha_channels` do.
    fn run(
        &mut self,
        device: &Device,
        view: &FrameView,
        detach_tau: bool,
        alpha_channels: f64,
        mut attempt: impl FnMut(&Device, &Loaded) -> Result<Totals, DeviceError>,
    ) -> Result<Totals, DeviceError> {
        loop {
            let capacity = self.buffers.pairs.capacity;
            let count = self.buffers.gaussians.count;
            let uniforms =
                transfer::step_uniforms(view, self.shape.near, count, capacity, detach_tau, alpha_channels);
            device.write(&self.buffers.fixed.uniforms, 0, &[uniforms]);
            device.write(&self.buffers.fixed.totals, 0, &[Totals { gaussians: count, ..Totals::default() }]);
            let totals = attempt(device, self)?;
            if self.pairs_fit(&totals) {
                return Ok(totals);
            }
            // A quarter more than needed now, up to the limit of the device.
            let most = (device.max_bytes / Pairs::LARGEST).min(u64::from(u32::MAX - 1)) as u32;
            if totals.pairs > most {
                return Err(device.too_large(Pairs::WHAT, Pairs::LARGEST * u64::from(totals.pairs)));
            }
            let capacity = totals.pairs.saturating_add(totals.pairs / 4).min(most);
            self.buffers.pairs = Pairs::new(device, capacity)?;
            self.buffers.scanned = Scanned::new(device, capacity.max(count))?;
            self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        }
    }

    /// Runs stages and reads the totals back.
    fn submit(
        &self,
        device: &Device,
        size: [u32; 2],
        stages: &[&[Dispatch]],
        mut encoder: wgpu::CommandEncoder,
    ) -> Result<Totals, DeviceError> {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        for dispatch in stages.iter().copied().flatten() {
            dispatch.record(&mut pass, size);
        }
        drop(pass);
        let Fixed { totals, staging, .. } = &self.buffers.fixed;
        Ok(device.submit_and_read(encoder, totals, staging, 1)?[0])
    }

    /// The image as the camera shows it.
    fn seen(&self, device: &Device, size: [u32; 2]) -> Result<Vec<[f32; 4]>, DeviceError> {
        let PerPixel { image, seen, .. } = &self.buffers.pixels;
        let seen = if self.kernels.columns.learns_cameras { seen } else { image };
        device.read(seen, size[0] as usize * size[1] as usize)
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
