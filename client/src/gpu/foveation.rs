//! [`Foveation`]: the images of a foveated frame, and the passes that compose them.
//!
//! A foveated frame has two passes for the same eyes, wide and inset, and one that composes both into the target.
//! Two passes rather than one of four views: a pass has one viewport and one draw order, and most Gaussians are
//! outside the inset.

use glam::UVec2;
use program::Fault;

use super::device::Gpu;
use super::division::{Division, part_size};
use super::layers::{layer_views, sampled_views};
use super::stages::foveate::{self, ComposePass};
use super::stages::splat::PassUniforms;

/// Images, pipeline and uniforms for foveated frames, shared by all clips.
pub struct Foveation {
    /// Render targets by pass.
    pub(super) wide: Vec<wgpu::TextureView>,
    pub(super) inset: Vec<wgpu::TextureView>,
    pub(super) inset_passes: Vec<PassUniforms>,
    pub(super) composing: Vec<ComposePass>,
    pub(super) pipeline: wgpu::RenderPipeline,
    /// Composes in linear light; see [`Foveation::for_linear_light`].
    pub(super) linear_pipeline: Option<wgpu::RenderPipeline>,
    /// Size of the images.
    pub(super) size: UVec2,
    format: wgpu::TextureFormat,
    eyes_per_pass: u32,
}

impl Foveation {
    /// For `eyes` eyes with images of up to `full` pixels in `format`, and insets of up to `side_max` of their
    /// sides.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub fn new(
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        eyes: usize,
        full: UVec2,
        side_max: f32,
    ) -> Result<Foveation, Fault> {
        let eyes_per_pass = if gpu.caps.multiview { eyes as u32 } else { 1 };
        let size = part_size(full, side_max);
        gpu.allocate("the inset", || {
            let image = || {
                let sampled = wgpu::TextureUsages::TEXTURE_BINDING;
                let texture = gpu.image("foveation", size, eyes as u32, format, sampled);
                let targets = layer_views(&texture, format, eyes_per_pass);
                (sampled_views(&texture, eyes_per_pass), targets)
            };
            let ((wide_images, wide), (inset_images, inset)) = (image(), image());
            let layout = ComposePass::layout(gpu, eyes_per_pass);
            let pass_layout = PassUniforms::layout(gpu, eyes_per_pass);
            let images = wide_images.iter().zip(&inset_images);
            let composing =
                images.map(|(wide, inset)| ComposePass::new(gpu, &layout, eyes_per_pass, [wide, inset]));
            Ok(Foveation {
                composing: composing.collect(),
                inset_passes: wide
                    .iter()
                    .map(|_| PassUniforms::new(gpu, &pass_layout, eyes_per_pass))
                    .collect(),
                pipeline: foveate::pipeline(gpu, &layout, format, eyes_per_pass, false)?,
                linear_pipeline: None,
                format,
                wide,
                inset,
                size,
                eyes_per_pass,
            })
        })?
    }

    /// With the pipeline for frames that a compositor blends in linear light.
    ///
    /// # Errors
    /// As for [`Foveation::new`].
    pub fn for_linear_light(mut self, gpu: &Gpu) -> Result<Foveation, Fault> {
        let layout = ComposePass::layout(gpu, self.eyes_per_pass);
        let pipeline = foveate::pipeline(gpu, &layout, self.format, self.eyes_per_pass, true)?;
        self.linear_pipeline = Some(pipeline);
        Ok(self)
    }

    /// Writes how the images of the eyes are composed, for the next submission.
    pub(super) fn write(&self, gpu: &Gpu, divisions: &[Division]) {
        for (pass, divisions) in self.composing.iter().zip(divisions.chunks(self.eyes_per_pass as usize)) {
            let uniforms: Vec<_> = divisions.iter().map(Division::uniform).collect();
            pass.write(gpu, &uniforms);
        }
    }
}
