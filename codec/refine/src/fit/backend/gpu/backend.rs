//! [`Gpu`]: a graphics device as a back end.

use shaders::fit::layout::{Memory, State};

use super::buffers::{Fixed, Pairs, PerGaussian, PerPixel, Scanned};
use super::device::Device;
use super::kernels::{Dispatch, Kernels};
use super::plan::{Buffers, Plan};
use super::transfer;
use crate::fit::backend::{Backend, DeviceError, Gradient, StepConfig, StepReport, TrainingState};
use crate::fit::loss::{LAMBDA, lpips_loss};
use crate::fit::parameters::Parameters;
use crate::fit::views::{FrameView, RenderedImage, TrainingView};

/// Pairs of a splat and a tile for which there is room at first.
const FIRST_PAIRS: u32 = 1 << 14;

/// A graphics device that fits.
pub struct Gpu {
    device: Device,
    loaded: Option<Loaded>,
}

/// Gaussians on the device, with all that it takes to fit them.
struct Loaded {
    /// A row of zeros with their columns.
    shape: Parameters<f32>,
    kernels: Kernels,
    buffers: Buffers,
    plan: Plan,
}

impl Gpu {
    /// The fastest device of the machine.
    ///
    /// # Errors
    /// [`DeviceError::Missing`] without one that is capable enough.
    pub fn open() -> Result<Gpu, DeviceError> {
        Ok(Gpu { device: Device::open()?, loaded: None })
    }

    /// The gradient of a loss of what was loaded, given its gradient by the pixels of what `view` shows.
    /// `detach_tau`: see [`ForwardPass::backward`](crate::fit::cpu::ForwardPass::backward).
    ///
    /// # Errors
    /// A [`DeviceError`].
    ///
    /// # Panics
    /// If nothing was loaded, or there are not as many pixels in `d_picture` as in the image.
    pub fn gradient(
        &mut self,
        view: &FrameView,
        d_picture: &[[f32; 4]],
        detach_tau: bool,
    ) -> Result<Gradient<f32>, DeviceError> {
        let (device, loaded) = self.loaded();
        let size = [view.camera.width, view.camera.height];
        assert_eq!(
            d_picture.len() as u64,
            u64::from(size[0]) * u64::from(size[1]),
            "a gradient for each pixel"
        );
        loaded.make_room(device, size)?;
        let before: Vec<Memory> = device.read(&loaded.buffers.gaussians.memory, loaded.count())?;
        let state = loaded.repeat(device, view, detach_tau, |device, loaded| {
            device.write(&loaded.buffers.pixels.d_picture, 0, d_picture);
            let stages = [&loaded.plan.forward[..], &loaded.plan.backward];
            loaded.carry_out(device, size, &stages, device.encoder())
        })?;
        let Buffers { gaussians, .. } = &loaded.buffers;
        let drawn = state.drawn as usize;
        let values =
            transfer::rows_of(device, &gaussians.d_parameters, &loaded.shape, drawn, loaded.count())?;
        let order: Vec<u32> = device.read(loaded.buffers.order(), drawn)?;
        let after: Vec<Memory> = device.read(&gaussians.memory, loaded.count())?;
        device.write(&gaussians.memory, 0, &before);
        let mut places: Vec<usize> = (0..drawn).collect();
        places.sort_unstable_by_key(|place| order[*place]);
        let rows: Vec<u32> = places.iter().map(|place| order[*place]).collect();
        let pull = |row: &u32| after[*row as usize].pull - before[*row as usize].pull;
        Ok(Gradient {
            values: values.select(&places),
            screen: rows.iter().map(pull).collect(),
            rows,
            non_finite: state.non_finite as usize,
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

    fn load(&mut self, gaussians: TrainingState) -> Result<(), DeviceError> {
        let columns = transfer::columns_of(&gaussians.parameters);
        let device = &self.device;
        let count = u32::try_from(gaussians.parameters.len()).unwrap_or(u32::MAX);
        // Nothing else of what was loaded outlives this.
        let (kernels, buffers) = match self.loaded.take() {
            Some(Loaded { kernels, buffers, .. }) if kernels.columns == columns => (kernels, Some(buffers)),
            _ => (Kernels::new(device, columns), None),
        };
        let buffers = match buffers {
            Some(buffers) if buffers.gaussians.count == count => buffers,
            Some(Buffers { fixed, pixels, pairs, gaussians, scanned }) => {
                // One after the other, not both at once.
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
                pixels: PerPixel::new(device, [1, 1], None)?,
                gaussians: PerGaussian::new(device, count, columns)?,
                scanned: Scanned::new(device, FIRST_PAIRS.max(count))?,
                pairs: Pairs::new(device, FIRST_PAIRS)?,
            },
        };
        transfer::upload(device, &buffers.gaussians, &gaussians);
        let plan = Plan::new(device, &kernels, &buffers)?;
        self.loaded = Some(Loaded { shape: gaussians.parameters.zeros(1), kernels, buffers, plan });
        Ok(())
    }

    fn render(&mut self, view: &FrameView) -> Result<RenderedImage<f32>, DeviceError> {
        let (device, loaded) = self.loaded();
        let (width, height) = (view.camera.width, view.camera.height);
        loaded.make_room(device, [width, height])?;
        loaded.repeat(device, view, true, |device, loaded| {
            loaded.carry_out(device, [width, height], &[&loaded.plan.forward], device.encoder())
        })?;
        let pixels = loaded.picture(device, [width, height])?;
        Ok(RenderedImage { width, height, pixels })
    }

    fn step(&mut self, training: &TrainingView, config: &StepConfig) -> Result<StepReport, DeviceError> {
        let (device, loaded) = self.loaded();
        let (view, photograph) = (training.view(), &training.photograph);
        let size = [view.camera.width, view.camera.height];
        let pixels = photograph.pixels.len();
        assert_eq!(
            pixels as u64,
            u64::from(size[0]) * u64::from(size[1]),
            "a photograph of the camera's size"
        );
        loaded.make_room(device, size)?;
        device.write(&loaded.buffers.pixels.photograph, 0, &transfer::photograph(photograph));
        device.write(&loaded.buffers.fixed.pace, 0, &[transfer::adam_uniforms(config)]);
        let mut perceptual = 0.0;
        let state = loaded.repeat(device, &view, config.detach_tau, |device, loaded| {
            let Plan { forward, loss, backward, adam } = &loaded.plan;
            let after = [&loss[..], backward, std::slice::from_ref(adam)];
            let mut encoder = device.encoder();
            let Some(lpips) = config.lpips else {
                encoder.clear_buffer(&loaded.buffers.pixels.d_picture.raw, 0, None);
                let stages = [&forward[..], after[0], after[1], after[2]];
                return loaded.carry_out(device, size, &stages, encoder);
            };
            let state = loaded.carry_out(device, size, &[forward], encoder)?;
            if !loaded.has_room_for(&state) {
                return Ok(state);
            }
            let part = lpips_loss(&loaded.picture(device, size)?, photograph, lpips);
            perceptual = part.value;
            device.write(&loaded.buffers.pixels.d_picture, 0, &part.gradient);
            loaded.carry_out(device, size, &after, device.encoder())
        })?;
        let channels = (3 * pixels).max(1) as f64;
        let [absolute, similarity] = [state.absolute, state.similarity].map(|sum| f64::from(sum) / channels);
        Ok(StepReport {
            loss: (1.0 - LAMBDA) * absolute + LAMBDA * (1.0 - similarity) + perceptual,
            drawn: state.drawn as usize,
            non_finite: state.non_finite as usize,
        })
    }

    fn store(&mut self) -> Result<TrainingState, DeviceError> {
        let (device, loaded) = self.loaded();
        transfer::download(device, &loaded.buffers.gaussians, &loaded.shape)
    }

    fn peak_device_bytes(&self) -> Option<u64> {
        Some(self.device.peak_bytes())
    }
}

impl Loaded {
    fn count(&self) -> usize {
        self.buffers.gaussians.count as usize
    }

    /// Makes room for images of `size`.
    fn make_room(&mut self, device: &Device, size: [u32; 2]) -> Result<(), DeviceError> {
        if !self.buffers.pixels.has_room(size) {
            self.buffers.pixels = PerPixel::new(device, size, Some(&self.buffers.pixels))?;
            self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        }
        Ok(())
    }

    fn has_room_for(&self, state: &State) -> bool {
        // A sum that is too large stays at the largest number.
        state.pairs <= self.buffers.pairs.capacity && state.pairs != u32::MAX
    }

    /// Does what `attempt` does until there is room for all pairs of splats and tiles.
    fn repeat(
        &mut self,
        device: &Device,
        view: &FrameView,
        detach_tau: bool,
        mut attempt: impl FnMut(&Device, &Loaded) -> Result<State, DeviceError>,
    ) -> Result<State, DeviceError> {
        loop {
            let capacity = self.buffers.pairs.capacity;
            let count = self.buffers.gaussians.count;
            device.write(&self.buffers.fixed.step, 0, &[transfer::step(view, count, capacity, detach_tau)]);
            device.write(&self.buffers.fixed.state, 0, &[State { gaussians: count, ..State::default() }]);
            let state = attempt(device, self)?;
            if self.has_room_for(&state) {
                return Ok(state);
            }
            // A quarter more than there are now, if there can be so many.
            let most = (device.max_bytes / Pairs::LARGEST).min(u64::from(u32::MAX - 1)) as u32;
            if state.pairs > most {
                return Err(device.too_large(Pairs::WHAT, Pairs::LARGEST * u64::from(state.pairs)));
            }
            let wanted = state.pairs.saturating_add(state.pairs / 4).min(most);
            self.buffers.pairs = Pairs::new(device, wanted)?;
            self.buffers.scanned = Scanned::new(device, wanted.max(count))?;
            self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        }
    }

    /// Carries stages out, and brings back what they tell.
    fn carry_out(
        &self,
        device: &Device,
        size: [u32; 2],
        stages: &[&[Dispatch]],
        mut encoder: wgpu::CommandEncoder,
    ) -> Result<State, DeviceError> {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        for dispatch in stages.iter().copied().flatten() {
            dispatch.record(&mut pass, size);
        }
        drop(pass);
        let Fixed { state, landing, .. } = &self.buffers.fixed;
        Ok(device.submit_and_read(encoder, state, landing, 1)?[0])
    }

    fn picture(&self, device: &Device, size: [u32; 2]) -> Result<Vec<[f32; 4]>, DeviceError> {
        device.read(&self.buffers.pixels.picture, size[0] as usize * size[1] as usize)
    }
}

#[cfg(test)]
mod tests {
    use crate::fit::backend::cpu;
    use crate::fit::loss::LAMBDA;
    use crate::fit::optimizer::{BETA1, BETA2, EPSILON};
    use crate::fit::parameters::NORM_MIN;

    /// What the shaders are told is what the CPU computes with.
    #[test]
    fn constants_are_those_of_the_cpu() {
        assert_eq!(shaders::fit::ADAM, [BETA1, BETA2, EPSILON].map(|x| x as f32));
        assert_eq!(shaders::fit::LAMBDA, LAMBDA as f32);
        let raster = [shaders::ALPHA_MIN, shaders::ALPHA_MAX, shaders::fit::TRANSMITTANCE_MIN];
        assert_eq!(raster, [codec::ALPHA_MIN, cpu::ALPHA_MAX, cpu::TRANSMITTANCE_MIN].map(|x| x as f32));
        assert_eq!(shaders::fit::LENGTH_MIN, NORM_MIN as f32);
        assert_eq!([shaders::NEAR, shaders::BLUR], [cpu::NEAR, cpu::BLUR].map(|x| x as f32));
    }
}
