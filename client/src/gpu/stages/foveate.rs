//! Stage `foveate`: the pipeline that composes the wide image and the inset of an eye, and the uniforms of a pass.

use std::mem::size_of;

use shaders::layout::Foveation;
use shaders::{FOVEATION, FRAGMENT_ENTRY, INSET, LINEAR, VERTEX_ENTRY, WIDE, compose_foveate};

use super::splat::multiview_mask;
use crate::gpu::device::Gpu;

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
        let uniforms = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("foveation"),
            size: u64::from(views) * size_of::<Foveation>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
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

    /// Writes the uniforms of eye `eye` of the pass for the next submission.
    pub(in crate::gpu) fn write(&self, gpu: &Gpu, eye: usize, foveation: &Foveation) {
        let offset = (eye * size_of::<Foveation>()) as u64;
        gpu.queue.write_buffer(&self.uniforms, offset, bytemuck::bytes_of(foveation));
    }
}

/// The pipeline for passes of `views` eyes into targets of `format`.
pub(in crate::gpu) fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    format: wgpu::TextureFormat,
    views: u32,
) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("foveate"),
        source: wgpu::ShaderSource::Wgsl(compose_foveate(views).into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("foveate"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("foveate"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some(VERTEX_ENTRY),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(FRAGMENT_ENTRY),
            compilation_options: Default::default(),
            targets: &[Some(format.into())],
        }),
        multiview_mask: multiview_mask(views),
        cache: None,
    })
}
