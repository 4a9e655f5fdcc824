//! What runs on the device: steps in flight, and commands whose results the host waits for.
//!
//! A step is a batch of commands with its own buffers for the photograph, which it reads, and for the results, which
//! the host reads while later steps run. A step with too many pairs of splats and tiles changes nothing, nor do the steps behind
//! it, which the device had before the host knew: all of them begin again, in order, with larger buffers. The result does not
//! depend on how large the buffers were.

use std::collections::VecDeque;

use bytemuck::{Pod, pod_read_unaligned};
use shaders::fit::CAMERA_NUMBERS;
use shaders::fit::layout::{AdamUniforms, Response, StepUniforms, Totals};

use super::buffers::{Buffers, IN_FLIGHT, Pairs, PerPixel};
use super::device::Device;
use super::kernels::Kernels;
use super::plan::{Plan, StepPart};
use super::timer::Timer;
use super::traffic;
use crate::fit::backend::{DeviceError, StepConfig, StepReport};
use crate::fit::cameras::{RESPONSE_NUMBERS, ViewGradient, respond};
use crate::fit::loss::{LAMBDA, Lpips, lpips_loss};
use crate::fit::parameters::{Carried, Parameters};
use crate::fit::views::{Photograph, RenderedImage};

/// What a step gives its kernels, beside the photograph.
#[derive(Clone, Copy)]
pub(super) struct Inputs {
    pub(super) uniforms: StepUniforms,
    pub(super) adam_uniforms: AdamUniforms,
    pub(super) response: Response,
}

/// A step that the device was given, and what it takes to give it again.
pub(super) struct Begun {
    inputs: Inputs,
    /// Its buffers among those that the steps in flight take in turn.
    turn: usize,
    submission: wgpu::SubmissionIndex,
}

/// A training state on the device, with all that a step needs.
pub(super) struct Loaded {
    /// A row of zeros with the columns of the parameters.
    pub(super) shape: Parameters<f32>,
    /// The past of the rows, which the device does not change.
    pub(super) carried: Vec<Carried>,
    pub(super) kernels: Kernels,
    pub(super) buffers: Buffers,
    pub(super) plan: Plan,
    /// The steps that the device was given, oldest first.
    pub(super) in_flight: VecDeque<Begun>,
    /// The buffers that the last of them took.
    pub(super) turn: usize,
    /// Reports of the steps before, which the device is done with.
    pub(super) reports: VecDeque<StepReport>,
    /// Times steps, one at a time.
    pub(super) timer: Option<Timer>,
}

/// What a batch of commands leaves.
#[derive(Clone, Copy)]
pub(super) struct Results {
    pub(super) totals: Totals,
    /// The gradient with respect to the camera, if it is learned.
    d_camera: [f32; CAMERA_NUMBERS],
}

impl Results {
    /// The gradient with respect to the view.
    pub(super) fn by_view(&self) -> ViewGradient<f32> {
        let numbers = &self.d_camera;
        ViewGradient {
            time: numbers[0],
            rotation: [numbers[1], numbers[2], numbers[3]],
            translation: [numbers[4], numbers[5], numbers[6]],
            log_focal: numbers[7],
        }
    }

    /// The report of a step on an image of `size`.
    pub(super) fn report(&self, inputs: &Inputs) -> StepReport {
        let Totals { drawn, non_finite, absolute, similarity, .. } = self.totals;
        let [width, height] = inputs.uniforms.size.map(f64::from);
        let channels = (3.0 * width * height).max(1.0);
        let [absolute, similarity] = [absolute, similarity].map(|sum| f64::from(sum) / channels);
        let by_response: [f64; RESPONSE_NUMBERS] = std::array::from_fn(|i| f64::from(self.d_camera[8 + i]));
        StepReport {
            loss: (1.0 - LAMBDA) * absolute + LAMBDA * (1.0 - similarity),
            drawn: drawn as usize,
            non_finite: non_finite as usize,
            camera: (inputs.uniforms.learns_camera != 0).then(|| self.by_view().numbers(&by_response)),
        }
    }
}

impl Loaded {
    pub(super) fn count(&self) -> usize {
        self.buffers.gaussians.count as usize
    }

    /// Grows the buffers for images of `size`.
    pub(super) fn resize(&mut self, device: &Device, size: [u32; 2]) -> Result<(), DeviceError> {
        if !self.buffers.pixels.fits(size) {
            // The steps in flight may begin again and have their photographs in these buffers.
            self.settle(device)?;
            self.buffers.pixels = PerPixel::new(device, size, Some(&self.buffers.pixels))?;
            self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        }
        Ok(())
    }

    /// The number of the buffers that the next step takes.
    pub(super) fn next_turn(&mut self) -> usize {
        self.turn = (self.turn + 1) % (IN_FLIGHT + 1);
        self.turn
    }

    /// A whole step, with LPIPS from the CPU.
    pub(super) fn step_with_lpips(
        &mut self,
        device: &Device,
        inputs: &Inputs,
        photograph: &Photograph,
        config: &StepConfig,
        lpips: &Lpips<f32>,
    ) -> Result<(), DeviceError> {
        device.count(|counts| counts.steps += 1);
        let write = |device: &Device, loaded: &Loaded| {
            device.write(&loaded.buffers.pixels.photograph, 0, &photograph.words());
        };
        self.run(device, inputs, write, |plan| [&plan.forward])?;
        let size = inputs.uniforms.size;
        let image = self.image(device, size)?;
        let seen = config.response.map(|response| respond(&image, &response));
        let term = lpips_loss(seen.as_ref().unwrap_or(&image.pixels), photograph, lpips);
        device.write(&self.buffers.pixels.d_image, 0, &term.gradient);
        let results = self.run_once(device, size, &self.plan.step()[1..])?;
        let report = results.report(inputs);
        self.reports.push_back(StepReport { loss: report.loss + term.value, ..report });
        Ok(())
    }

    /// The image of the last run.
    pub(super) fn image(
        &self,
        device: &Device,
        [width, height]: [u32; 2],
    ) -> Result<RenderedImage<f32>, DeviceError> {
        let pixels = device.read(&self.buffers.pixels.image, width as usize * height as usize)?;
        Ok(RenderedImage { width, height, pixels })
    }

    /// Begins a step on the photograph in the buffer of this turn.
    pub(super) fn begin(&mut self, device: &Device, inputs: Inputs, turn: usize) {
        device.count(|counts| counts.steps += 1);
        if self.in_flight.is_empty() {
            // What ran before may have halted.
            device.write(&self.buffers.fixed.totals, 0, &[self.first_totals()]);
        }
        let submission = self.submit_step(device, &inputs, turn);
        self.in_flight.push_back(Begun { inputs, turn, submission });
    }

    fn submit_step(&self, device: &Device, inputs: &Inputs, turn: usize) -> wgpu::SubmissionIndex {
        self.write_inputs(device, inputs);
        let (totals, start) = (&self.buffers.fixed.totals, self.first_totals());
        // A step before it may have halted.
        device.write(totals, 0, &bytemuck::cast_slice::<Totals, u32>(&[start])[..Totals::HALTED as usize]);
        let pixels = &self.buffers.pixels;
        let mut encoder = device.encoder();
        encoder.copy_buffer_to_buffer(&pixels.photographs[turn].raw, 0, &pixels.photograph.raw, 0, None);
        self.submit(device, inputs.uniforms.size, &self.plan.step(), encoder, turn)
    }

    /// Ends the oldest step in flight: the report is the last of `reports`.
    pub(super) fn end(&mut self, device: &Device) -> Result<(), DeviceError> {
        loop {
            let Some(Begun { inputs, turn, submission }) = self.in_flight.front() else { return Ok(()) };
            if self.in_flight.len() == 1 {
                device.count(|counts| counts.waits += 1);
            }
            device.wait_for(submission.clone())?;
            let results = self.results(device, *turn)?;
            if self.pairs_fit(&results.totals) {
                let touched = traffic::touched_bytes(&self.buffers, &results.totals, inputs.uniforms.size);
                device.count(|counts| counts.touched_bytes += touched);
                self.reports.push_back(results.report(inputs));
                self.in_flight.pop_front();
                if let Some(timer) = &mut self.timer {
                    timer.add(device, self.plan.step().into_iter().flatten())?;
                }
                return Ok(());
            }
            self.repeat(device, results.totals.pairs)?;
        }
    }

    /// Ends all steps in flight.
    pub(super) fn settle(&mut self, device: &Device) -> Result<(), DeviceError> {
        (0..self.in_flight.len()).try_for_each(|_| self.end(device))
    }

    /// Begins all steps in flight again, with room for so many pairs. The results of the first were read.
    fn repeat(&mut self, device: &Device, pairs: u32) -> Result<(), DeviceError> {
        let repeats = self.in_flight.len() as u64;
        device.count(|counts| (counts.repeats, counts.waits) = (counts.repeats + repeats, counts.waits + 1));
        for Begun { turn, submission, .. } in self.in_flight.iter().skip(1) {
            device.wait_for(submission.clone())?;
            self.results(device, *turn)?;
        }
        self.make_room(device, pairs)?;
        device.write(&self.buffers.fixed.totals, 0, &[self.first_totals()]);
        let mut steps = std::mem::take(&mut self.in_flight);
        for step in &mut steps {
            step.submission = self.submit_step(device, &step.inputs, step.turn);
        }
        self.in_flight = steps;
        Ok(())
    }

    /// Ends all steps in flight, then runs the parts that `parts` picks after what `prepare` writes, again with larger
    /// buffers until all pairs fit.
    pub(super) fn run<const N: usize>(
        &mut self,
        device: &Device,
        inputs: &Inputs,
        prepare: impl Fn(&Device, &Loaded),
        parts: impl Fn(&Plan) -> [&[StepPart]; N],
    ) -> Result<Results, DeviceError> {
        self.settle(device)?;
        loop {
            self.write_inputs(device, inputs);
            device.write(&self.buffers.fixed.totals, 0, &[self.first_totals()]);
            prepare(device, self);
            let results = self.run_once(device, inputs.uniforms.size, &parts(&self.plan))?;
            if self.pairs_fit(&results.totals) {
                return Ok(results);
            }
            self.make_room(device, results.totals.pairs)?;
        }
    }

    /// Runs parts and waits for their results. No step is in flight.
    pub(super) fn run_once(
        &self,
        device: &Device,
        size: [u32; 2],
        parts: &[&[StepPart]],
    ) -> Result<Results, DeviceError> {
        device.count(|counts| counts.waits += 1);
        device.wait_for(self.submit(device, size, parts, device.encoder(), 0))?;
        self.results(device, 0)
    }

    fn write_inputs(&self, device: &Device, inputs: &Inputs) {
        let Inputs { uniforms, adam_uniforms, response } = *inputs;
        let uniforms = StepUniforms {
            gaussians: self.buffers.gaussians.count,
            pair_capacity: self.buffers.pairs.capacity,
            ..uniforms
        };
        let fixed = &self.buffers.fixed;
        device.write(&fixed.uniforms, 0, &[uniforms]);
        device.write(&fixed.adam_uniforms, 0, &[adam_uniforms]);
        device.write(&fixed.response, 0, &[response]);
    }

    fn first_totals(&self) -> Totals {
        Totals { gaussians: self.buffers.gaussians.count, ..Totals::default() }
    }

    /// Submits parts after what `encoder` holds. The results go to the buffer of this turn.
    fn submit(
        &self,
        device: &Device,
        size: [u32; 2],
        parts: &[&[StepPart]],
        mut encoder: wgpu::CommandEncoder,
        turn: usize,
    ) -> wgpu::SubmissionIndex {
        let parts: Vec<&StepPart> = parts.iter().copied().flatten().collect();
        for (i, part) in parts.iter().enumerate() {
            let timestamp_writes = self.timer.as_ref().map(|timer| timer.around(i));
            let descriptor = wgpu::ComputePassDescriptor { label: Some(part.name), timestamp_writes };
            let mut pass = encoder.begin_compute_pass(&descriptor);
            part.dispatches.iter().for_each(|dispatch| dispatch.record(&mut pass, size));
            device.count(|counts| counts.dispatches += part.dispatches.len() as u64);
        }
        if let Some(timer) = &self.timer {
            timer.resolve(&mut encoder, parts.len());
        }
        let fixed = &self.buffers.fixed;
        let staging = &fixed.results[turn];
        let [totals, d_camera] = [size_of::<Totals>(), CAMERA_NUMBERS * size_of::<f32>()].map(|n| n as u64);
        encoder.copy_buffer_to_buffer(&fixed.totals.raw, 0, &staging.raw, 0, Some(totals));
        encoder.copy_buffer_to_buffer(&fixed.d_camera.raw, 0, &staging.raw, totals, Some(d_camera));
        device.submit(encoder, staging)
    }

    /// The results of the submission of this turn, which is done.
    fn results(&self, device: &Device, turn: usize) -> Result<Results, DeviceError> {
        let bytes = device.take(&self.buffers.fixed.results[turn])?;
        let totals = first::<Totals>(&bytes);
        Ok(Results { totals, d_camera: first(&bytes[size_of::<Totals>()..]) })
    }

    /// Whether the buffers held all pairs. A count that overflowed is saturated.
    fn pairs_fit(&self, totals: &Totals) -> bool {
        totals.pairs <= self.buffers.pairs.capacity && totals.pairs != u32::MAX
    }

    /// Makes room for a quarter more than `pairs`, up to the limit of the device.
    fn make_room(&mut self, device: &Device, pairs: u32) -> Result<(), DeviceError> {
        let most = (device.max_bytes / Pairs::LARGEST).min(u64::from(u32::MAX - 1)) as u32;
        if pairs > most {
            return Err(device.too_large(Pairs::WHAT, Pairs::LARGEST * u64::from(pairs)));
        }
        self.buffers.pairs = Pairs::new(device, pairs.saturating_add(pairs / 4).min(most))?;
        self.plan = Plan::new(device, &self.kernels, &self.buffers)?;
        Ok(())
    }
}

fn first<T: Pod>(bytes: &[u8]) -> T {
    pod_read_unaligned(&bytes[..size_of::<T>()])
}
