//! [`Renderer`]: draws frames of a clip or a take into any render target.
//!
//! A frame has two steps. [`Renderer::prepare`] finds and sorts the visible Gaussians, for which it needs no target;
//! [`Renderer::record`] records the passes.

use std::sync::Arc;
use std::time::Instant;

use glam::UVec2;
use program::Fault;
use shaders::filter_variance;

use super::counts::{Coverage, FrameCounts};
use super::device::Gpu;
use super::division::Division;
use super::foveation::Foveation;
use super::frame_views::{EYES_MAX, FrameViews};
use super::pass::begin;
use super::segment::TakeLayout;
use super::settings::{Cutoff, RenderSettings};
use super::slots::Slots;
use super::stages::alive::Culler;
use super::stages::clip::GpuClip;
use super::stages::count::Counter;
use super::stages::drawn_set::{DrawnPart, DrawnSet};
use super::stages::linear_light::LinearLight;
use super::stages::quads::Quads;
use super::stages::sort::{Item, Sorter};
use super::stages::splat::PassUniforms;
use super::timing::GpuTimer;
use crate::view::View;

/// The frames that a renderer draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLayout {
    /// Format of the targets.
    pub format: wgpu::TextureFormat,
    /// Number of eyes, 1 or 2.
    pub eyes: usize,
    /// Whether frames may be foveated, see [`RenderSettings::inset`].
    pub foveated: bool,
}

impl FrameLayout {
    /// Frames of one eye or two, never foveated.
    pub fn plain(format: wgpu::TextureFormat, eyes: usize) -> FrameLayout {
        FrameLayout { format, eyes, foveated: false }
    }
}

/// What a renderer draws.
enum Drawn {
    /// What another one holds.
    Shared(Arc<GpuClip>),
    /// Segments that come and go.
    Own(Box<Slots>),
}

impl Drawn {
    fn clip(&self) -> &Arc<GpuClip> {
        match self {
            Drawn::Shared(clip) => clip,
            Drawn::Own(slots) => slots.clip(),
        }
    }
}

/// The pipelines of a clip or a take, and the memory of a frame.
pub struct Renderer {
    drawn: Drawn,
    layout: FrameLayout,
    eyes_per_pass: u32,
    /// Uniforms of each pass that shows whole views.
    passes: Vec<PassUniforms>,
    sets: Vec<DrawnSet>,
    quads: Quads,
    items: Vec<Item>,
    sorter: Sorter,
    timer: Option<GpuTimer>,
    counter: Option<Counter>,
    prepared: Option<Prepared>,
    /// Whether a frame was recorded.
    has_drawn: bool,
}

/// A frame that was prepared.
#[derive(Clone, Copy)]
struct Prepared {
    views: FrameViews,
    t: f64,
    cutoff: Cutoff,
}

impl Renderer {
    /// Builds the buffers, and the pipelines that the device lacks, to draw frames of `layout` of `clip`. Both eyes are
    /// drawn in one pass if [`Caps::multiview`](super::Caps::multiview) is set.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    ///
    /// # Panics
    /// If the number of eyes is neither 1 nor 2.
    pub fn new(gpu: &Gpu, clip: Arc<GpuClip>, layout: FrameLayout) -> Result<Renderer, Fault> {
        Renderer::for_drawn(gpu, Drawn::Shared(clip), layout)
    }

    /// As [`Renderer::new`], for a take that has no resident segment yet.
    ///
    /// # Errors
    /// [`Fault::Device`] if the take does not fit the device, or there is not enough memory.
    ///
    /// # Panics
    /// As for [`Renderer::new`].
    pub fn new_take(gpu: &Gpu, take: TakeLayout, layout: FrameLayout) -> Result<Renderer, Fault> {
        Renderer::for_drawn(gpu, Drawn::Own(Box::new(Slots::new(gpu, &take)?)), layout)
    }

    fn for_drawn(gpu: &Gpu, drawn: Drawn, layout: FrameLayout) -> Result<Renderer, Fault> {
        let FrameLayout { format, eyes, foveated } = layout;
        assert!((1..=EYES_MAX).contains(&eyes), "one eye or two");
        let eyes_per_pass = if gpu.caps.multiview { eyes as u32 } else { 1 };
        let pass_layout = PassUniforms::layout(gpu, eyes_per_pass);
        let clip = drawn.clip();
        let rows = clip.sets().map(|set| set.buffers.rows).max().unwrap_or(0);
        let (sets, passes, timer) = gpu.allocate("the renderer", || {
            let set = |set| DrawnSet::new(gpu, set, &pass_layout, format, eyes_per_pass, foveated);
            let pass = |_| PassUniforms::new(gpu, &pass_layout, eyes_per_pass);
            let passes = (0..eyes).step_by(eyes_per_pass as usize);
            let sets = clip.sets().map(set).collect::<Result<_, Fault>>()?;
            Ok::<_, Fault>((sets, passes.map(pass).collect(), GpuTimer::new(gpu)))
        })??;
        Ok(Renderer {
            layout,
            eyes_per_pass,
            passes,
            sets,
            quads: Quads::new(gpu)?,
            items: Vec::with_capacity(rows),
            sorter: Sorter::new(rows),
            timer,
            counter: None,
            drawn,
            prepared: None,
            has_drawn: false,
        })
    }

    /// The clip, or what is drawn of the take now. Another renderer draws it as long as it likes: what it shares stays in
    /// memory.
    pub fn clip(&self) -> &Arc<GpuClip> {
        self.drawn.clip()
    }

    /// The segments of its own take; `None` if it draws what another one holds.
    pub fn slots(&mut self) -> Option<&mut Slots> {
        match &mut self.drawn {
            Drawn::Shared(_) => None,
            Drawn::Own(slots) => Some(slots),
        }
    }

    /// Number of eyes per pass, and of layers per target.
    pub fn eyes_per_pass(&self) -> u32 {
        self.eyes_per_pass
    }

    /// Number of render pipelines that the clip is drawn with.
    pub fn pipelines(&self) -> usize {
        self.sets.len()
    }

    /// Finds and sorts the Gaussians to draw at time `t` of the clip or the take, clamped to 0 to 1, in `views` of the same size, and
    /// writes them and the views for the next submission. Follow it with [`Renderer::record`], and submit its commands
    /// before the next call.
    ///
    /// # Panics
    /// If the number of views does not match the renderer, or `settings` have an inset and its frames are never
    /// foveated.
    pub fn prepare(&mut self, gpu: &Gpu, t: f64, views: &[View], settings: &RenderSettings) -> FrameCounts {
        assert_eq!(views.len(), self.layout.eyes, "one view per eye");
        assert!(settings.inset.is_none() || self.layout.foveated, "the renderer foveates");
        let t = within_clip(t);
        let views = FrameViews::new(views, settings.inset);
        let counts = self.sort(gpu, t, &views, settings);
        for (pass, drawn) in self.passes.iter().zip(views.drawn().chunks(self.eyes_per_pass as usize)) {
            pass.write(gpu, t, settings.cutoff, drawn, views.blur(), self.clip());
        }
        self.prepared = Some(Prepared { views, t, cutoff: settings.cutoff });
        counts
    }

    /// Number of render passes of the prepared frame; 0 before the first.
    pub fn passes(&self) -> usize {
        let parts = |prepared: Prepared| if prepared.views.divisions().is_some() { 3 } else { 1 };
        self.passes.len() * self.prepared.map_or(0, parts)
    }

    /// Records the prepared frame into `encoder`: clears the targets to transparent black and draws the clip. `targets`
    /// has one target of [`Renderer::eyes_per_pass`] layers per pass; the viewport is the upper left corner of the
    /// targets. A foveated frame needs the images of `foveation`. With `linear`, colours suit a compositor that blends
    /// in linear light; a foveated frame then needs [`Foveation::for_linear_light`], another frame the images.
    ///
    /// # Panics
    /// If no frame was prepared, the number of targets does not match the renderer, or the frame lacks images
    /// of the same eyes and format that are large enough.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        targets: &[wgpu::TextureView],
        foveation: Option<&Foveation>,
        linear: Option<&LinearLight>,
    ) {
        assert_eq!(targets.len(), self.passes.len(), "one target per pass");
        let prepared = self.prepared.expect("a frame was prepared");
        if std::mem::replace(&mut self.has_drawn, true) {
            gpu.save_pipelines();
        }
        let slot = self.timer.as_mut().and_then(|timer| {
            timer.collect();
            timer.free_slot()
        });
        let timer = self.timer.as_ref().zip(slot);
        let writes = |pass, passes| timer.and_then(|(timer, slot)| timer.writes(slot, pass, passes));
        match prepared.views.divisions() {
            None => self.record_plain(encoder, targets, &prepared, linear, writes),
            Some(divisions) => {
                let foveation = foveation.expect("a foveated frame has images");
                self.write_foveation(gpu, foveation, &prepared, divisions);
                self.record_foveated(encoder, targets, &prepared, foveation, linear.is_some(), writes);
            }
        }
        if let Some((timer, slot)) = self.timer.as_mut().zip(slot) {
            timer.fetch(encoder, slot);
        }
    }

    /// Records a frame of whole views, by way of the images of `linear` if a compositor blends it in linear light.
    fn record_plain<'w>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &[wgpu::TextureView],
        prepared: &Prepared,
        linear: Option<&LinearLight>,
        writes: impl Fn(usize, usize) -> Option<wgpu::RenderPassTimestampWrites<'w>>,
    ) {
        let size = prepared.views.full()[0].size;
        let parts = if linear.is_some() { 2 } else { 1 };
        let passes = parts * targets.len();
        assert!(linear.is_none_or(|linear| size.cmple(linear.size).all()), "the frame fits its image");
        for (i, target) in targets.iter().enumerate() {
            let drawn = linear.map_or(target, |linear| &linear.targets[i]);
            self.draw(encoder, &self.passes[i], DrawnPart::All, drawn, size, writes(parts * i, passes));
            if let Some(linear) = linear {
                linear.record(encoder, i, target, size, writes(parts * i + 1, passes));
            }
        }
    }

    /// Records a foveated frame, in `linear` light or not.
    fn record_foveated<'w>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &[wgpu::TextureView],
        prepared: &Prepared,
        foveation: &Foveation,
        linear: bool,
        writes: impl Fn(usize, usize) -> Option<wgpu::RenderPassTimestampWrites<'w>>,
    ) {
        let (full, part) = (prepared.views.full()[0].size, prepared.views.drawn()[0].size);
        assert_eq!(foveation.wide.len(), self.passes.len(), "images for as many eyes");
        assert!(part.cmple(foveation.size).all(), "the inset fits its image");
        let pipeline = match linear {
            true => foveation.linear_pipeline.as_ref().expect("it composes in linear light"),
            false => &foveation.pipeline,
        };
        let passes = 3 * targets.len();
        for (i, target) in targets.iter().enumerate() {
            let [wide, inset] = [&foveation.wide[i], &foveation.inset[i]];
            self.draw(encoder, &self.passes[i], DrawnPart::All, wide, part, writes(3 * i, passes));
            let uniforms = &foveation.inset_passes[i];
            self.draw(encoder, uniforms, DrawnPart::Inset, inset, part, writes(3 * i + 1, passes));
            let timing = writes(3 * i + 2, passes);
            let mut pass = begin(encoder, "foveate", target, full, self.eyes_per_pass, timing);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &foveation.composing[i].group, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    /// GPU time of the latest measured frame in milliseconds; `None` without timestamps or before the first
    /// result. Does not wait.
    pub fn gpu_ms(&mut self) -> Option<f64> {
        self.timer.as_mut().and_then(GpuTimer::latest_ms)
    }

    /// GPU time in milliseconds of the latest frame that was measured since the last call; `None` if there is none, or
    /// the device wrote no time. After waiting for the GPU it is the time of the last frame. Does not wait.
    pub fn new_gpu_ms(&mut self) -> Option<f64> {
        self.timer.as_mut().and_then(GpuTimer::new_ms)
    }

    /// Counts the fragments of the prepared frame exactly. Draws again and waits for the GPU: for measuring, not for
    /// playing.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost or is out of memory.
    ///
    /// # Panics
    /// If no frame was prepared.
    pub fn count(&mut self, gpu: &Gpu) -> Result<Coverage, Fault> {
        let counter = match self.counter.take() {
            Some(counter) => counter,
            None => gpu.allocate("counting", || {
                Counter::new(gpu, &self.sets, self.quads.clone(), self.layout.foveated)
            })??,
        };
        let Prepared { views, t, cutoff } = self.prepared.expect("a frame was prepared");
        let coverage = counter.count(gpu, &self.sets, t, cutoff, &views, self.clip());
        self.counter = Some(counter);
        coverage
    }

    /// Runs the stages `alive` and `sort` for all sets and uploads the sorted rows.
    fn sort(&mut self, gpu: &Gpu, t: f64, views: &FrameViews, settings: &RenderSettings) -> FrameCounts {
        let mut counts = FrameCounts::default();
        let clip = self.drawn.clip();
        let t_s = t * clip.duration_s;
        for (set, drawn) in clip.sets().zip(&mut self.sets) {
            let start = Instant::now();
            let mut culler = Culler::new(views, settings, clip.origin, clip.near, &mut self.items);
            for (number, segment, t) in set.at(t_s, clip.duration_s) {
                segment.rows.alive(t, segment.first_entry(number), &mut culler);
            }
            counts.alive += culler.alive;
            let alive_end = Instant::now();
            drawn.sort(&mut self.sorter, &mut self.items, settings.inset.is_some());
            counts.alive_ms += (alive_end - start).as_secs_f64() * 1e3;
            counts.sort_ms += alive_end.elapsed().as_secs_f64() * 1e3;
            counts.sorted += drawn.count(DrawnPart::All);
            drawn.upload(gpu, set, t_s, clip.duration_s);
        }
        counts
    }

    /// Writes the views of the insets, and how they are composed.
    fn write_foveation(&self, gpu: &Gpu, foveation: &Foveation, prepared: &Prepared, divisions: &[Division]) {
        let eyes_per_pass = self.eyes_per_pass as usize;
        for (pass, divisions) in foveation.inset_passes.iter().zip(divisions.chunks(eyes_per_pass)) {
            let mut insets = [divisions[0].inset; EYES_MAX];
            insets.iter_mut().zip(divisions).for_each(|(inset, division)| *inset = division.inset);
            let (insets, blur) = (&insets[..divisions.len()], filter_variance(false));
            pass.write(gpu, prepared.t, prepared.cutoff, insets, blur, self.clip());
        }
        foveation.write(gpu, divisions);
    }

    /// Records a pass that draws `part` of the Gaussians in views of `size` pixels.
    fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        uniforms: &PassUniforms,
        part: DrawnPart,
        target: &wgpu::TextureView,
        size: UVec2,
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) {
        let mut pass = begin(encoder, "splat", target, size, self.eyes_per_pass, timestamp_writes);
        pass.set_bind_group(0, &uniforms.group, &[]);
        for set in self.sets.iter().filter(|set| set.count(part) > 0) {
            pass.set_pipeline(&set.pipeline);
            pass.set_bind_group(1, &set.group, &[]);
            self.quads.draw(&mut pass, set.first_batch(part), set.count(part));
        }
    }
}

/// Clamps a time to the clip, which the records are valid for; NaN becomes 0.
fn within_clip(t: f64) -> f64 {
    if t > 0.0 { t.min(1.0) } else { 0.0 }
}
