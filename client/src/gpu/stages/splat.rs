//! Stage `splat`: the pipeline that draws the sorted Gaussians of a set, and the uniforms of a pass.

use std::mem::size_of;
use std::num::NonZeroU32;

use glam::{DMat3, DVec3};
use shaders::layout::{Frame, ViewUniform};
use shaders::{FRAGMENT_ENTRY, FRAME, Features, Purpose, VERTEX_ENTRY, VIEWS, compose};

use super::alive::slope_limits;
use crate::gpu::device::Gpu;
use crate::gpu::settings::Cutoff;
use crate::view::View;

/// The uniforms of one pass: bind group 0.
pub(in crate::gpu) struct PassUniforms {
    frame: wgpu::Buffer,
    views: wgpu::Buffer,
    pub(in crate::gpu) group: wgpu::BindGroup,
}

impl PassUniforms {
    /// Layout of bind group 0 for passes of `views` eyes.
    pub(in crate::gpu) fn layout(gpu: &Gpu, views: u32) -> wgpu::BindGroupLayout {
        let entry = |binding, visibility, bytes: usize| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: wgpu::BufferSize::new(bytes as u64),
            },
            count: None,
        };
        gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("pass"),
            entries: &[
                entry(FRAME, wgpu::ShaderStages::VERTEX_FRAGMENT, size_of::<Frame>()),
                entry(VIEWS, wgpu::ShaderStages::VERTEX, views as usize * size_of::<ViewUniform>()),
            ],
        })
    }

    pub(in crate::gpu) fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout, views: u32) -> PassUniforms {
        let uniform = |label, size: usize| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let frame = uniform("frame", size_of::<Frame>());
        let views = uniform("views", views as usize * size_of::<ViewUniform>());
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pass"),
            layout,
            entries: &[
                wgpu::BindGroupEntry { binding: FRAME, resource: frame.as_entire_binding() },
                wgpu::BindGroupEntry { binding: VIEWS, resource: views.as_entire_binding() },
            ],
        });
        PassUniforms { frame, views, group }
    }

    /// Writes the uniforms for the next submission. `blur` is the variance of a field's blur in px^2 of the views,
    /// `origin` that of the clip.
    pub(in crate::gpu) fn write(
        &self,
        gpu: &Gpu,
        t: f64,
        cutoff: Cutoff,
        views: &[View],
        blur: f32,
        origin: DVec3,
    ) {
        let time = t as f32;
        let time_rest = (t - f64::from(time)) as f32;
        let frame = Frame { time, time_rest, radius_max: cutoff.radius_max() };
        gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(&frame));
        for (i, view) in views.iter().enumerate() {
            let offset = (i * size_of::<ViewUniform>()) as u64;
            gpu.queue.write_buffer(&self.views, offset, bytemuck::bytes_of(&uniform_of(view, blur, origin)));
        }
    }
}

fn uniform_of(view: &View, blur: f32, origin: DVec3) -> ViewUniform {
    let (slope_min, slope_max) = slope_limits(view);
    let rotation = DMat3::from_mat4(view.view_from_world).as_mat3().to_cols_array_2d();
    ViewUniform {
        view_from_world: rotation.map(|[x, y, z]| [x, y, z, 0.0]),
        eye: (view.eye() - origin).as_vec3().to_array(),
        focal: view.focal.to_array(),
        principal: view.principal.to_array(),
        size: view.size.as_vec2().to_array(),
        slope_min: slope_min.to_array(),
        slope_max: slope_max.to_array(),
        blur,
        ..Default::default()
    }
}

/// The pipeline of a set with `features` in passes of `views` eyes of frames that may be `foveated`, blending
/// premultiplied colours.
pub(in crate::gpu) fn pipeline(
    gpu: &Gpu,
    features: Features,
    groups: &[Option<&wgpu::BindGroupLayout>],
    format: wgpu::TextureFormat,
    views: u32,
    foveated: bool,
) -> wgpu::RenderPipeline {
    let target = wgpu::ColorTargetState {
        format,
        blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
        write_mask: wgpu::ColorWrites::ALL,
    };
    build(gpu, features, Purpose::Draw { views, foveated }, groups, target)
}

/// Builds a pipeline of the shader composed for `purpose`.
pub(in crate::gpu) fn build(
    gpu: &Gpu,
    features: Features,
    purpose: Purpose,
    groups: &[Option<&wgpu::BindGroupLayout>],
    target: wgpu::ColorTargetState,
) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("splat"),
        source: wgpu::ShaderSource::Wgsl(compose(features, purpose).into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("splat"),
        bind_group_layouts: groups,
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("splat"),
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
            targets: &[Some(target)],
        }),
        multiview_mask: match purpose {
            Purpose::Draw { views, .. } => multiview_mask(views),
            Purpose::Count { .. } => None,
        },
        cache: None,
    })
}

/// Layer mask of a pass of `views` eyes; `None` for one eye.
pub(in crate::gpu) fn multiview_mask(views: u32) -> Option<NonZeroU32> {
    if views > 1 { NonZeroU32::new((1 << views) - 1) } else { None }
}
