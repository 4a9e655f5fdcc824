//! Stage `foveate`: the pipeline that composes the wide image and the inset of an eye, and the uniforms of a pass.

use std::mem::size_of;

use program::Fault;
use shaders::layout::Foveation;
use shaders::{FOVEATION, INSET, LINEAR, WIDE, compose_foveate};

use crate::gpu::device::{Gpu, PipelineParts};

/// The bind group of one pass.
pub(in crate::gpu) struct ComposePass {
    uniforms: wgpu::Buffer,
    pub(in crate::gpu) group: wgpu::BindGroup,
}

impl ComposePass {
    /// Binds the images of a pass: views of one texture layer per eye.
    pub(in crate::gpu) fn new(
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        views: u32,
        [wide, inset]: [&wgpu::TextureView; 2],
    ) -> ComposePass {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let uniforms = gpu.empty_buffer("foveation", u64::from(views) * size_of::<Foveation>() as u64, usage);
        let linear = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("foveation"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("foveation"),
            layout,
            entries: &[
                entry(FOVEATION, uniforms.as_entire_binding()),
                entry(WIDE, wgpu::BindingResource::TextureView(wide)),
                entry(INSET, wgpu::BindingResource::TextureView(inset)),
                entry(LINEAR, wgpu::BindingResource::Sampler(&linear)),
            ],
        });
        ComposePass { uniforms, group }
    }

    /// Layout of the bind group for passes of `views` eyes.
    pub(in crate::gpu) fn layout(gpu: &Gpu, views: u32) -> wgpu::BindGroupLayout {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let image = |filterable| wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable },
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        let uniforms = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: wgpu::BufferSize::new(u64::from(views) * size_of::<Foveation>() as u64),
        };
        gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("foveation"),
            entries: &[
                entry(FOVEATION, uniforms),
                entry(WIDE, image(true)),
                entry(INSET, image(false)),
                entry(LINEAR, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
            ],
        })
    }

    /// Writes the uniforms of the eyes of the pass for the next submission.
    pub(in crate::gpu) fn write(&self, gpu: &Gpu, eyes: &[Foveation]) {
        gpu.queue.write_buffer(&self.uniforms, 0, bytemuck::cast_slice(eyes));
    }
}

/// The pipeline for passes of `views` eyes into targets of `format`, in `linear` light or not.
///
/// # Errors
/// As for [`Gpu::pipeline`].
pub(in crate::gpu) fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    format: wgpu::TextureFormat,
    views: u32,
    linear: bool,
) -> Result<wgpu::RenderPipeline, Fault> {
    gpu.pipeline(&PipelineParts {
        label: "foveate",
        source: compose_foveate(views, linear),
        groups: &[Some(layout)],
        target: format.into(),
        views,
    })
}
