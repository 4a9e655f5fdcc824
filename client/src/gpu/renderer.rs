//! [`Renderer`]: draws frames of a clip into any render target.

use std::sync::Arc;
use std::time::Instant;

use glam::UVec2;
use program::Fault;

use super::clip::GpuClip;
use super::counts::{Coverage, FrameCounts};
use super::device::Gpu;
use super::drawn_set::DrawnSet;
use super::settings::RenderSettings;
use super::stages::alive::EYES_MAX;
use super::stages::count::Counter;
use super::stages::quads::Quads;
use super::stages::sort::{Item, Sorter};
use super::stages::splat::{PassUniforms, multiview_mask};
use super::timing::GpuTimer;
use crate::view::View;

/// The pipelines of a clip, and the memory of a frame.
pub struct Renderer {
    clip: Arc<GpuClip>,
    eyes: usize,
    eyes_per_pass: u32,
    passes: Vec<PassUniforms>,
    sets: Vec<DrawnSet>,
    quads: Quads,
    items: Vec<Item>,
    sorter: Sorter,
    timer: Option<GpuTimer>,
    counter: Option<Counter>,
}

impl Renderer {
    /// Builds the pipelines and buffers to draw `clip` for `eyes` eyes, 1 or 2, into targets of `format`.
    /// Both eyes are drawn in one pass if [`Caps::multiview`](super::Caps::multiview) is set.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    ///
    /// # Panics
    /// If `eyes` is neither 1 nor 2.
    pub fn new(
        gpu: &Gpu,
        clip: Arc<GpuClip>,
        format: wgpu::TextureFormat,
        eyes: usize,
    ) -> Result<Renderer, Fault> {
        assert!((1..=EYES_MAX).contains(&eyes), "one eye or two");
        let eyes_per_pass = if gpu.caps.multiview { eyes as u32 } else { 1 };
        let pass_layout = PassUniforms::layout(gpu, eyes_per_pass);
        let rows = clip.sets().map(|set| set.rows.len()).max().unwrap_or(0);
        let (sets, passes, timer) = gpu.allocate("the renderer", || {
            let set = |set| DrawnSet::new(gpu, set, &pass_layout, format, eyes_per_pass);
            let pass = |_| PassUniforms::new(gpu, &pass_layout, eyes_per_pass);
            let passes = (0..eyes).step_by(eyes_per_pass as usize);
            (clip.sets().map(set).collect(), passes.map(pass).collect(), GpuTimer::new(gpu))
        })?;
        Ok(Renderer {
            eyes,
            eyes_per_pass,
            passes,
            sets,
            quads: Quads::new(gpu)?,
            items: Vec::with_capacity(rows),
            sorter: Sorter::new(rows),
            timer,
            counter: None,
            clip,
        })
    }

    /// The clip.
    pub fn clip(&self) -> &Arc<GpuClip> {
        &self.clip
    }

    /// Number of eyes per pass, and of layers per target.
    pub fn eyes_per_pass(&self) -> u32 {
        self.eyes_per_pass
    }

    /// Number of render pipelines.
    pub fn pipelines(&self) -> usize {
        self.sets.len()
    }

    /// Records a frame at clip time `t`, clamped to 0 to 1, into `encoder`: clears the targets to transparent
    /// black and draws the clip. `targets` has one target of [`Renderer::eyes_per_pass`] layers per pass.
    /// All `views` have the same size; the viewport is the upper left corner of the targets.
    ///
    /// Submit `encoder` before the next call.
    ///
    /// # Panics
    /// If the number of views or targets does not match the renderer.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        t: f64,
        views: &[View],
        settings: &RenderSettings,
        targets: &[wgpu::TextureView],
    ) -> FrameCounts {
        assert_eq!(views.len(), self.eyes, "one view per eye");
        assert_eq!(targets.len(), self.passes.len(), "one target per pass");
        let t = within_clip(t);
        let counts = self.sort(gpu, t, views, settings);
        for (pass, views) in self.passes.iter().zip(views.chunks(self.eyes_per_pass as usize)) {
            pass.write(gpu, t, settings.cutoff, views, self.clip.origin);
        }
        let slot = self.timer.as_mut().and_then(|timer| {
            timer.latest_ms();
            timer.free_slot()
        });
        for (i, target) in targets.iter().enumerate() {
            let timer = self.timer.as_ref().zip(slot);
            self.record_pass(
                encoder,
                i,
                target,
                views[0].size,
                timer.map(|(timer, slot)| timer.writes(slot, i, targets.len())),
            );
        }
        if let Some((timer, slot)) = self.timer.as_mut().zip(slot) {
            timer.fetch(encoder, slot);
        }
        counts
    }

    /// GPU time of the latest measured frame in milliseconds; `None` without timestamps or before the first
    /// result. Does not wait.
    pub fn gpu_ms(&mut self) -> Option<f64> {
        self.timer.as_mut().and_then(GpuTimer::latest_ms)
    }

    /// Counts the fragments of the latest frame exactly; the arguments must be those of its
    /// [`Renderer::draw`]. Draws again and waits for the GPU: for measuring, not for playing.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost or is out of memory.
    pub fn count(
        &mut self,
        gpu: &Gpu,
        t: f64,
        views: &[View],
        settings: &RenderSettings,
    ) -> Result<Coverage, Fault> {
        let counter = match self.counter.take() {
            Some(counter) => counter,
            None => gpu.allocate("counting", || Counter::new(gpu, &self.sets, self.quads.clone()))?,
        };
        let coverage =
            counter.count(gpu, &self.sets, within_clip(t), settings.cutoff, views, self.clip.origin);
        self.counter = Some(counter);
        coverage
    }

    /// Runs the stages `alive` and `sort` for all sets and uploads the sorted rows.
    fn sort(&mut self, gpu: &Gpu, t: f64, views: &[View], settings: &RenderSettings) -> FrameCounts {
        let mut counts = FrameCounts::default();
        for (set, drawn) in self.clip.sets().zip(&mut self.sets) {
            let start = Instant::now();
            let seen = set.rows.alive(t, views, settings, &mut self.items);
            counts.alive += seen.alive;
            counts.culled += seen.culled;
            let alive_end = Instant::now();
            self.sorter.sort(&mut self.items, &mut drawn.order);
            counts.alive_ms += (alive_end - start).as_secs_f64() * 1e3;
            counts.sort_ms += alive_end.elapsed().as_secs_f64() * 1e3;
            counts.sorted += drawn.order.len() as u32;
            gpu.queue.write_buffer(&drawn.order_buffer, 0, bytemuck::cast_slice(&drawn.order));
        }
        counts
    }

    fn record_pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pass: usize,
        target: &wgpu::TextureView,
        size: UVec2,
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) {
        let uniforms = &self.passes[pass];
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splat"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            timestamp_writes,
            multiview_mask: multiview_mask(self.eyes_per_pass),
            ..Default::default()
        });
        pass.set_viewport(0.0, 0.0, size.x as f32, size.y as f32, 0.0, 1.0);
        pass.set_bind_group(0, &uniforms.group, &[]);
        for set in self.sets.iter().filter(|set| !set.order.is_empty()) {
            pass.set_pipeline(&set.pipeline);
            pass.set_bind_group(1, &set.group, &[]);
            self.quads.draw(&mut pass, set.order.len() as u32);
        }
    }
}

/// Clamps a time to the clip, which the records are valid for; NaN becomes 0.
fn within_clip(t: f64) -> f64 {
    if t > 0.0 { t.min(1.0) } else { 0.0 }
}
