//! [`UiPainter`]: draws the user interface, over a picture or alone.

use super::device::Gpu;

/// Render target of the user interface.
pub(crate) struct UiTarget<'a> {
    pub(super) view: &'a wgpu::TextureView,
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
    /// Whether to draw over the present content instead of clearing it.
    pub(super) draws_over: bool,
}

/// Draws the output of egui.
pub(crate) struct UiPainter {
    renderer: egui_wgpu::Renderer,
}

impl UiPainter {
    /// A painter for targets of `format`, which must not convert colours.
    pub(crate) fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> UiPainter {
        // Dithering would change the picture below.
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        UiPainter { renderer: egui_wgpu::Renderer::new(&gpu.device, format, options) }
    }

    /// A painter for images of a headset's runtime.
    #[cfg(feature = "xr")]
    pub(crate) fn for_runtime(gpu: &Gpu, format: super::RuntimeFormat) -> UiPainter {
        UiPainter::new(gpu, format.drawn())
    }

    /// Updates the textures and records the drawing of `triangles` into `target`.
    pub(crate) fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &UiTarget<'_>,
        triangles: &[egui::ClippedPrimitive],
        pixels_per_point: f32,
        mut textures: egui::TexturesDelta,
    ) {
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                self.renderer.update_texture(&gpu.device, &gpu.queue, id, delta);
            }
        }
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: target.size, pixels_per_point };
        // egui panics if it cannot create buffers on a lost device.
        gpu.unless_lost(|| self.record(gpu, encoder, target, triangles, &screen));
        for id in textures.free.drain() {
            self.renderer.free_texture(&id);
        }
    }

    fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &UiTarget<'_>,
        triangles: &[egui::ClippedPrimitive],
        screen: &egui_wgpu::ScreenDescriptor,
    ) {
        self.renderer.update_buffers(&gpu.device, &gpu.queue, encoder, triangles, screen);
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("interface"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: if target.draws_over {
                        wgpu::LoadOp::Load
                    } else {
                        wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)
                    },
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        self.renderer.render(&mut pass.forget_lifetime(), triangles, screen);
    }
}
