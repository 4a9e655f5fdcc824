//! [`UiPainter`]: draws the interface over a picture.

use super::device::Gpu;
use super::surface::SurfaceFrame;

/// Draws what egui laid out.
pub(crate) struct UiPainter {
    renderer: egui_wgpu::Renderer,
}

impl UiPainter {
    /// A painter into images of `format`, which must take display-referred colours as they are.
    pub(crate) fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> UiPainter {
        // No dithering: the picture below must stay as it is drawn.
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        UiPainter { renderer: egui_wgpu::Renderer::new(&gpu.device, format, options) }
    }

    /// Records the drawing of `triangles` over what `frame` holds, after bringing the textures up
    /// to date.
    pub(crate) fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &SurfaceFrame,
        triangles: &[egui::ClippedPrimitive],
        pixels_per_point: f32,
        mut textures: egui::TexturesDelta,
    ) {
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                self.renderer.update_texture(&gpu.device, &gpu.queue, id, delta);
            }
        }
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: frame.size, pixels_per_point };
        self.renderer.update_buffers(&gpu.device, &gpu.queue, encoder, triangles, &screen);
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("interface"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &frame.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        self.renderer.render(&mut pass.forget_lifetime(), triangles, &screen);
        for id in textures.free.drain() {
            self.renderer.free_texture(&id);
        }
    }
}
