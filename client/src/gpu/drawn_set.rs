//! [`DrawnSet`]: the pipeline of one Gaussian set and its draw order in the current frame.

use shaders::Features;

use super::clip::GaussianSet;
use super::device::Gpu;
use super::stages::splat;

/// A Gaussian set of the clip with everything that drawing it needs.
pub(super) struct DrawnSet {
    pub(super) features: Features,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) pipeline: wgpu::RenderPipeline,
    /// Rows to draw, back to front.
    pub(super) order: Vec<u32>,
    pub(super) order_buffer: wgpu::Buffer,
    pub(super) group: wgpu::BindGroup,
}

impl DrawnSet {
    /// Builds the pipeline for targets of `format` and passes of `eyes_per_pass` eyes.
    pub(super) fn new(
        gpu: &Gpu,
        set: &GaussianSet,
        pass_layout: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
        eyes_per_pass: u32,
    ) -> DrawnSet {
        let features = set.buffers.features;
        let layout = set.buffers.layout(gpu);
        let groups = [Some(pass_layout), Some(&layout)];
        let order_buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("order"),
            size: 4 * set.rows.len().max(1) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        DrawnSet {
            features,
            pipeline: splat::pipeline(gpu, features, &groups, format, eyes_per_pass),
            order: Vec::with_capacity(set.rows.len()),
            group: set.buffers.bind(gpu, &layout, &order_buffer),
            order_buffer,
            layout,
        }
    }
}
