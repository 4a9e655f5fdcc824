//! Stage `linear_light`: [`LinearLight`], images whose colours are converted for a compositor that blends in linear
//! light, and the pass that converts them.
//!
//! A headset's compositor decodes sRGB images and blends their light; splats and the panel blend display-referred
//! colours. A colour c premultiplied by alpha a as displayed would be decoded to less than a times the light of c, so
//! edges would be dark over the room. Straight alpha (`UNPREMULTIPLIED_ALPHA`) gives the same light in a pixel, but the
//! compositor interpolates between pixels, and the black of a transparent pixel would darken the edge beside it.

use glam::UVec2;
use program::Fault;
use shaders::{DRAWN, compose_linear_light};

use crate::gpu::device::{Gpu, PipelineParts};
use crate::gpu::layers::{layer_views, sampled_views};
use crate::gpu::pass::begin;
#[cfg(feature = "xr")]
use crate::gpu::ui::UiTarget;

/// Images to draw into with display-referred blending, and what converts them.
pub struct LinearLight {
    /// Render targets by pass.
    pub(in crate::gpu) targets: Vec<wgpu::TextureView>,
    groups: Vec<wgpu::BindGroup>,
    pipeline: wgpu::RenderPipeline,
    layers_per_pass: u32,
    /// Size of the images.
    pub(in crate::gpu) size: UVec2,
}

impl LinearLight {
    /// An image of `size` pixels with `layers` layers, one per eye, to be converted into targets of `format`.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub fn new(
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        layers: u32,
        size: UVec2,
    ) -> Result<LinearLight, Fault> {
        let layers_per_pass = if gpu.caps.multiview { layers } else { 1 };
        gpu.allocate("the image over the room", || {
            let texture =
                gpu.image("linear light", size, layers, format, wgpu::TextureUsages::TEXTURE_BINDING);
            let layout = layout(gpu);
            let bind = |view: &wgpu::TextureView| {
                let entry = wgpu::BindGroupEntry {
                    binding: DRAWN,
                    resource: wgpu::BindingResource::TextureView(view),
                };
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("linear light"),
                    layout: &layout,
                    entries: &[entry],
                })
            };
            let pipeline = gpu.pipeline(&PipelineParts {
                label: "linear light",
                source: compose_linear_light(layers_per_pass),
                groups: &[Some(&layout)],
                target: format.into(),
                views: layers_per_pass,
            })?;
            Ok(LinearLight {
                targets: layer_views(&texture, format, layers_per_pass),
                groups: sampled_views(&texture, layers_per_pass).iter().map(bind).collect(),
                pipeline,
                layers_per_pass,
                size,
            })
        })?
    }

    /// Target for the user interface, cleared before drawing.
    #[cfg(feature = "xr")]
    pub(crate) fn ui_target(&self) -> UiTarget<'_> {
        UiTarget { view: &self.targets[0], size: self.size.to_array(), draws_over: false }
    }

    /// Records the conversion of the image of one layer into `target`.
    #[cfg(feature = "xr")]
    pub(crate) fn convert(&self, encoder: &mut wgpu::CommandEncoder, target: &wgpu::TextureView) {
        self.record(encoder, 0, target, self.size, None);
    }

    /// Records pass `index`, which converts the upper left `size` pixels of its image into `target`.
    pub(in crate::gpu) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        index: usize,
        target: &wgpu::TextureView,
        size: UVec2,
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) {
        let layers = self.layers_per_pass;
        let mut pass = begin(encoder, "linear light", target, size, layers, timestamp_writes);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.groups[index], &[]);
        pass.draw(0..3, 0..1);
    }
}

fn layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("linear light"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: DRAWN,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2Array,
                multisampled: false,
            },
            count: None,
        }],
    })
}
