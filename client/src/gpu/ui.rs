//! [`UiPainter`]: draws the interface, over a picture or by itself.

use super::device::Gpu;

/// What the interface is drawn into.
pub(crate) struct UiTarget<'a> {
    pub(super) view: &'a wgpu::TextureView,
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
    /// Whether what it holds shows below the interface.
    pub(super) keeps: bool,
}

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

    /// A painter into images that a headset's runtime shows.
    #[cfg(feature = "xr")]
    pub(crate) fn for_runtime(gpu: &Gpu, format: super::RuntimeFormat) -> UiPainter {
        UiPainter::new(gpu, format.drawn())
    }

    /// Records the drawing of `triangles` into `target`, after bringing the textures up to date.
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
        // A device that is gone has no buffers, and the painter insists on them.
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
                    load: if target.keeps {
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
