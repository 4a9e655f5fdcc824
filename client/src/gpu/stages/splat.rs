//! Stage `splat`: the pipeline that draws the sorted Gaussians of a set, and the uniforms of a pass.

use std::mem::size_of;

use glam::{DMat3, DVec3};
use program::Fault;
use shaders::layout::{Frame, ViewUniform};
use shaders::{FRAME, Features, Purpose, VIEWS, compose};

use super::alive::slope_limits;
use super::clip::GpuClip;
use crate::gpu::device::{Gpu, PipelineParts};
use crate::gpu::frame_views::EYES_MAX;
use crate::gpu::settings::Cutoff;
use crate::view::View;

/// Offset of the views in the buffer of a pass: a multiple of what every device asks of offsets.
const VIEWS_OFFSET: usize = 256;

/// The uniforms of one pass: bind group 0. One buffer, so that a frame writes it at once.
pub(in crate::gpu) struct PassUniforms {
    buffer: wgpu::Buffer,
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
        let views_bytes = views as usize * size_of::<ViewUniform>();
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let buffer = gpu.empty_buffer("pass", (VIEWS_OFFSET + views_bytes) as u64, usage);
        let entry = |binding, offset: usize, bytes: usize| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &buffer,
                offset: offset as u64,
                size: wgpu::BufferSize::new(bytes as u64),
            }),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pass"),
            layout,
            entries: &[entry(FRAME, 0, size_of::<Frame>()), entry(VIEWS, VIEWS_OFFSET, views_bytes)],
        });
        PassUniforms { buffer, group }
    }

    /// Writes the uniforms for the next submission. `blur` is the variance of a field's blur in px^2 of the views,
    /// which show `clip`.
    pub(in crate::gpu) fn write(
        &self,
        gpu: &Gpu,
        t: f64,
        cutoff: Cutoff,
        views: &[View],
        blur: f32,
        clip: &GpuClip,
    ) {
        let time = t as f32;
        let time_rest = (t - f64::from(time)) as f32;
        let frame = Frame { time, time_rest, radius_max: cutoff.radius_max(), near: clip.near };
        let mut bytes = [0; VIEWS_OFFSET + EYES_MAX * size_of::<ViewUniform>()];
        bytes[..size_of::<Frame>()].copy_from_slice(bytemuck::bytes_of(&frame));
        let mut end = VIEWS_OFFSET;
        for view in views {
            let start = end;
            end += size_of::<ViewUniform>();
            bytes[start..end].copy_from_slice(bytemuck::bytes_of(&uniform_of(view, blur, clip.origin)));
        }
        gpu.queue.write_buffer(&self.buffer, 0, &bytes[..end]);
    }
}

const _: () = assert!(size_of::<Frame>() <= VIEWS_OFFSET);

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

/// The pipeline for `purpose` of a set with `features`, into `target`.
///
/// # Errors
/// As for [`Gpu::pipeline`].
pub(in crate::gpu) fn pipeline(
    gpu: &Gpu,
    features: Features,
    purpose: Purpose,
    groups: &[Option<&wgpu::BindGroupLayout>],
    target: wgpu::ColorTargetState,
) -> Result<wgpu::RenderPipeline, Fault> {
    let views = match purpose {
        Purpose::Draw { views, .. } => views,
        Purpose::Count { .. } => 1,
    };
    gpu.pipeline(&PipelineParts { label: "splat", source: compose(features, purpose), groups, target, views })
}
