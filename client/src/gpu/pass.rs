//! [`begin`]: begins a render pass into a part of a target.

use glam::UVec2;

use super::device::multiview_mask;

/// Begins a pass into the upper left `size` pixels of `target`, and clears all its `layers` layers.
pub(super) fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &'static str,
    target: &wgpu::TextureView,
    size: UVec2,
    layers: u32,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
) -> wgpu::RenderPass<'e> {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
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
        multiview_mask: multiview_mask(layers),
        ..Default::default()
    });
    pass.set_viewport(0.0, 0.0, size.x as f32, size.y as f32, 0.0, 1.0);
    pass
}
