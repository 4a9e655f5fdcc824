//! [`Bench`]: renders variants, measures the errors of their images, counts their work, and times it.

use std::collections::BTreeMap;
use std::mem::size_of;
use std::ptr;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use crate::parameter::ImageErrors;
use client::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer};
use client::view::View;
use codec::{Camera, Clip, Field};
use glam::UVec2;
use image::Rgba32FImage;
use image::imageops::{FilterType, resize};
use program::Fault;
use refine::image::Image;
use refine::reference::PosedView;
use shaders::CORNERS;
use shaders::layout::Ranges;

use super::errors::Expected;
use super::measured::{FrameTiming, Inspection};
use super::reduce;
use super::views::ViewSet;
use crate::device::{Fragments, Passes, device};

/// Number of times that each image is timed.
pub(super) const ROUNDS: usize = 7;

/// A way to render the clip. The default is the player with its default settings.
pub(super) struct Variant {
    /// Name in tables.
    pub(super) name: String,
    /// The Gaussians.
    pub(super) content: VariantContent,
    /// Settings of the renderer.
    pub(super) settings: RenderSettings,
    /// Size of the rendered image, if it differs from the measured one.
    pub(super) size: Option<UVec2>,
    /// Bits per channel.
    pub(super) depth: ChannelDepth,
    /// Number of eyes, and passes for them.
    pub(super) eyes: EyeMode,
}

impl Default for Variant {
    fn default() -> Variant {
        Variant {
            name: String::new(),
            content: VariantContent::default(),
            settings: RenderSettings::default(),
            size: None,
            depth: ChannelDepth::Sixteen,
            eyes: EyeMode::default(),
        }
    }
}

/// The Gaussians that a variant renders.
#[derive(Default)]
pub(super) enum VariantContent {
    /// The clip.
    #[default]
    Whole,
    /// Another clip.
    Other(Box<Clip>),
    /// At each instant, the Gaussians of the clip whose opacity is at least this.
    Alive(f64),
}

/// Number of eyes of a variant, and passes for them.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum EyeMode {
    #[default]
    One,
    /// Two in one pass, if the device supports that.
    TwoAtOnce,
    /// Two, in one pass each.
    TwoInTurn,
}

/// Renders variants of a clip.
pub(super) struct Bench<'a> {
    gpu: &'static Gpu,
    clip: &'a Clip,
    size: UVec2,
    views: &'a ViewSet,
    /// The setups of each inspected variant.
    placed: Vec<VariantSetups>,
    /// The whole clip in the memory of each device that renders it.
    wholes: Vec<(&'static Gpu, Arc<GpuClip>)>,
    /// Render targets, shared between variants.
    canvases: Vec<Canvas>,
}

/// A render target, shared by variants with the same device, size, depth, number of eyes and inset.
struct Canvas {
    gpu: &'static Gpu,
    size: UVec2,
    depth: ChannelDepth,
    eyes: usize,
    inset: Option<f32>,
    target: Rc<Offscreen>,
}

/// The renderers of a variant.
struct VariantSetups {
    settings: RenderSettings,
    /// One for all views, or one for each.
    setups: Vec<DrawSetup>,
}

/// A clip on a device, with a renderer and a target.
struct DrawSetup {
    gpu: &'static Gpu,
    renderer: Renderer,
    target: Rc<Offscreen>,
    size: UVec2,
    /// Number of Gaussians, including the plate's.
    rows: usize,
    /// Distance between the eyes in units of the clip; `None` for one eye.
    apart: Option<f64>,
}

impl<'a> Bench<'a> {
    pub(super) fn new(gpu: &'static Gpu, clip: &'a Clip, size: UVec2, views: &'a ViewSet) -> Bench<'a> {
        Bench { gpu, clip, size, views, placed: Vec::new(), wholes: Vec::new(), canvases: Vec::new() }
    }

    /// Renders a variant for the first time, measures the errors of its images and counts its work.
    pub(super) fn inspect(&mut self, variant: &Variant, expected: &Expected) -> Result<Inspection, Fault> {
        let mut setups = match variant.content {
            VariantContent::Alive(_) => {
                let views = self.views.pictures.iter();
                views.map(|posed_view| self.setup(variant, posed_view.t)).collect::<Result<_, _>>()?
            }
            VariantContent::Whole | VariantContent::Other(_) => vec![self.setup(variant, 0.0)?],
        };
        let (mut images, mut counts) = (Vec::new(), BTreeMap::new());
        for (i, posed_view) in self.views.pictures.iter().enumerate() {
            let setup = of_view(&mut setups, i);
            images.push(setup.image(posed_view, &variant.settings, self.size)?);
            for (name, count) in setup.counts(posed_view, &variant.settings)? {
                *counts.entry(name.to_owned()).or_default() += count / self.views.pictures.len() as f64;
            }
        }
        let mut inspection =
            Inspection { errors: ImageErrors::default(), counts, images: Vec::new(), turn: Vec::new() };
        if variant.eyes == EyeMode::One {
            for posed_view in &self.views.turn {
                let mut own = match variant.content {
                    VariantContent::Alive(_) => Some(self.setup(variant, posed_view.t)?),
                    VariantContent::Whole | VariantContent::Other(_) => None,
                };
                let setup = own.as_mut().unwrap_or(&mut setups[0]);
                inspection.turn.push(setup.image(posed_view, &variant.settings, self.size)?);
            }
            inspection.errors = expected.errors(&images, &inspection.turn)?;
            inspection.images = images;
        }
        self.placed.push(VariantSetups { settings: variant.settings, setups });
        Ok(inspection)
    }

    /// Times all views of variant `i`, in the order of [`Bench::inspect`], and returns the mean.
    pub(super) fn time(&mut self, i: usize) -> Result<FrameTiming, Fault> {
        let VariantSetups { settings, setups } = &mut self.placed[i];
        let mut mean = FrameTiming { gpu_timed: true, ..FrameTiming::default() };
        for (i, posed_view) in self.views.pictures.iter().enumerate() {
            let sample = of_view(setups, i).time(posed_view, settings)?;
            let share = |value: f64| value / self.views.pictures.len() as f64;
            mean.frame_ms += share(sample.frame_ms);
            mean.alive_ms += share(sample.alive_ms);
            mean.sort_ms += share(sample.sort_ms);
            mean.draw_ms += share(sample.draw_ms);
            mean.gpu_timed &= sample.gpu_timed;
        }
        Ok(mean)
    }

    /// Makes the setup of `variant` at clip time `t`.
    fn setup(&mut self, variant: &Variant, t: f64) -> Result<DrawSetup, Fault> {
        let gpu = match variant.eyes {
            EyeMode::TwoInTurn => {
                let fragments = if self.gpu.caps.f16 { Fragments::AsPlayers } else { Fragments::Single };
                device(Passes::PerEye, fragments)?
            }
            EyeMode::One | EyeMode::TwoAtOnce => self.gpu,
        };
        let rows = |clip: &Clip| clip.len() + clip.plate.as_ref().map_or(0, Field::len);
        let upload = |clip: &Clip| GpuClip::upload(gpu, clip).map(|on_gpu| (on_gpu, rows(clip)));
        let (clip, rows) = match &variant.content {
            VariantContent::Whole => (self.whole(gpu)?, rows(self.clip)),
            VariantContent::Other(clip) => upload(clip)?,
            VariantContent::Alive(least) => upload(&reduce::to_alive(self.clip, t, *least))?,
        };
        let depth = variant.depth;
        let apart = (variant.eyes != EyeMode::One)
            .then(|| Camera::EYE_DISTANCE_M / f64::from(self.clip.info.metres_per_unit));
        let eyes = 1 + usize::from(apart.is_some());
        let (size, inset) = (variant.size.unwrap_or(self.size), variant.settings.inset);
        let layout = FrameLayout { format: depth.format(), eyes, foveated: inset.is_some() };
        Ok(DrawSetup {
            gpu,
            renderer: Renderer::new(gpu, clip, layout)?,
            target: self.target(gpu, size, depth, eyes, inset)?,
            size,
            rows,
            apart,
        })
    }

    /// The whole clip in the memory of `gpu`; uploads it once.
    fn whole(&mut self, gpu: &'static Gpu) -> Result<Arc<GpuClip>, Fault> {
        if let Some((_, whole)) = self.wholes.iter().find(|(device, _)| ptr::eq(*device, gpu)) {
            return Ok(whole.clone());
        }
        let whole = GpuClip::upload(gpu, self.clip)?;
        self.wholes.push((gpu, whole.clone()));
        Ok(whole)
    }

    /// The render target for these properties; makes it once.
    fn target(
        &mut self,
        gpu: &'static Gpu,
        size: UVec2,
        depth: ChannelDepth,
        eyes: usize,
        inset: Option<f32>,
    ) -> Result<Rc<Offscreen>, Fault> {
        let is_it = |canvas: &&Canvas| {
            let Canvas { size: its_size, depth: its_depth, eyes: its_eyes, inset: its_inset, .. } = **canvas;
            ptr::eq(canvas.gpu, gpu)
                && (its_size, its_depth, its_eyes, its_inset) == (size, depth, eyes, inset)
        };
        if let Some(canvas) = self.canvases.iter().find(is_it) {
            return Ok(canvas.target.clone());
        }
        let target = Offscreen::new(gpu, size, eyes as u32, depth)?;
        let target = Rc::new(match inset {
            Some(side) => target.foveated(gpu, side)?,
            None => target,
        });
        self.canvases.push(Canvas { gpu, size, depth, eyes, inset, target: target.clone() });
        Ok(target)
    }
}

fn of_view(setups: &mut [DrawSetup], posed_view: usize) -> &mut DrawSetup {
    let last = setups.len() - 1;
    &mut setups[posed_view.min(last)]
}

impl DrawSetup {
    fn views(&self, posed_view: &PosedView) -> Vec<View> {
        let camera = &posed_view.camera;
        let eyes = self.apart.map_or(vec![camera.clone()], |distance| camera.stereo_pair(distance).to_vec());
        let scaled = |camera: &Camera| {
            let view = View::from_camera(camera);
            let scale = self.size.as_vec2() / view.size.as_vec2();
            View { focal: view.focal * scale, principal: view.principal * scale, size: self.size, ..view }
        };
        eyes.iter().map(scaled).collect()
    }

    /// Renders the image of the first eye and scales it to `full` pixels.
    fn image(
        &mut self,
        posed_view: &PosedView,
        settings: &RenderSettings,
        full: UVec2,
    ) -> Result<Image, Fault> {
        let views = self.views(posed_view);
        self.target.render(self.gpu, &mut self.renderer, posed_view.t, &views, settings)?;
        let pixels = self.target.read(self.gpu)?.swap_remove(0);
        let drawn = pixels.rgba.into_iter().flatten().collect();
        let mut image =
            Rgba32FImage::from_raw(self.size.x, self.size.y, drawn).expect("four numbers per pixel");
        if self.size != full {
            // Bilinear, as compositors do.
            image = resize(&image, full.x, full.y, FilterType::Triangle);
        }
        let pixels = image.pixels().map(|pixel| pixel.0.map(f64::from)).collect();
        Ok(Image { width: full.x, height: full.y, pixels })
    }

    fn counts(
        &mut self,
        posed_view: &PosedView,
        settings: &RenderSettings,
    ) -> Result<[(&'static str, f64); 9], Fault> {
        let views = self.views(posed_view);
        let counts = self.target.render(self.gpu, &mut self.renderer, posed_view.t, &views, settings)?;
        let coverage = self.renderer.count(self.gpu)?;
        let instances = f64::from(counts.sorted) * views.len() as f64;
        Ok([
            ("alive", f64::from(counts.alive)),
            ("sorted_keys", f64::from(counts.sorted)),
            ("drawn", f64::from(coverage.drawn)),
            ("covered_fragments", coverage.fragments as f64),
            ("vertex_invocations", f64::from(CORNERS) * instances),
            ("bytes_fetched", instances * self.bytes_of_instance()),
            ("gpu_bytes", self.renderer.clip().bytes() as f64),
            ("pipelines", self.renderer.pipelines() as f64),
            ("passes", self.renderer.passes() as f64),
        ])
    }

    /// Bytes that an instance reads: its index in the sort order and a record of mean size. Its four corners count
    /// once, because they share the reads.
    fn bytes_of_instance(&self) -> f64 {
        let clip = self.renderer.clip();
        let ranges = (self.renderer.pipelines() * size_of::<Ranges>()) as f64;
        size_of::<u32>() as f64 + (clip.bytes() as f64 - ranges) / self.rows.max(1) as f64
    }

    fn time(&mut self, posed_view: &PosedView, settings: &RenderSettings) -> Result<FrameTiming, Fault> {
        let views = self.views(posed_view);
        self.renderer.new_gpu_ms();
        let start = Instant::now();
        let counts = self.target.render(self.gpu, &mut self.renderer, posed_view.t, &views, settings)?;
        let frame_ms = start.elapsed().as_secs_f64() * 1e3;
        let (alive_ms, sort_ms) = (counts.alive_ms, counts.sort_ms);
        let gpu_ms = self.renderer.new_gpu_ms();
        let draw_ms = gpu_ms.unwrap_or(frame_ms - alive_ms - sort_ms);
        Ok(FrameTiming { frame_ms, alive_ms, sort_ms, draw_ms, gpu_timed: gpu_ms.is_some() })
    }
}
