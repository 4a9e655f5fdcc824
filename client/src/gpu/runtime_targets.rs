//! [`RuntimeTargets`]: render targets in the images of a headset's runtime. A
//! [`Renderer`](super::Renderer) draws into the images for the eyes, a [`LinearLight`](super::LinearLight)
//! converts into the images of the panel.

use program::Fault;

use super::device::vulkan::RuntimeImages;
use super::device::{Gpu, multiview_mask};
use super::layers::layer_views;
use super::readback::{Pixels, Readback};

/// The images of a swapchain; images for the eyes have one layer per eye.
pub(crate) struct RuntimeTargets {
    images: Vec<Target>,
    layers_per_pass: u32,
    readbacks: Vec<Readback>,
}

struct Target {
    texture: wgpu::Texture,
    /// One view per pass.
    targets: Vec<wgpu::TextureView>,
}

impl RuntimeTargets {
    /// Creates render targets for `images`.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub(crate) fn new(gpu: &Gpu, images: &RuntimeImages) -> Result<RuntimeTargets, Fault> {
        let layers_per_pass = if gpu.caps.multiview { images.layers() } else { 1 };
        let drawn = images.format().drawn();
        let wrap = |texture: wgpu::Texture| {
            let targets = layer_views(&texture, drawn, layers_per_pass);
            Target { texture, targets }
        };
        let readbacks = if images.readable() { images.layers() } else { 0 };
        Ok(RuntimeTargets {
            images: images.wrap(gpu).into_iter().map(wrap).collect(),
            layers_per_pass,
            readbacks: (0..readbacks)
                .map(|_| Readback::new(gpu, images.size(), drawn))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Render targets of image `index`, one per pass of a renderer.
    pub(crate) fn targets(&self, index: usize) -> &[wgpu::TextureView] {
        &self.images[index].targets
    }

    /// Records a fill of image `index` with a premultiplied colour.
    pub(crate) fn fill(&self, encoder: &mut wgpu::CommandEncoder, index: usize, rgba: [f64; 4]) {
        let [r, g, b, a] = rgba;
        for view in self.targets(index) {
            encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("fill"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a }),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                multiview_mask: multiview_mask(self.layers_per_pass),
                ..Default::default()
            });
        }
    }

    /// Records a readback of image `index`, and its transition back to a colour target, which the runtime
    /// expects.
    pub(crate) fn record_read(&self, encoder: &mut wgpu::CommandEncoder, index: usize) {
        let texture = &self.images[index].texture;
        for (layer, readback) in self.readbacks.iter().enumerate() {
            readback.record(encoder, texture, layer as u32);
        }
        let state = wgpu::TextureUses::COLOR_TARGET;
        let back = wgpu::TextureTransition { texture, selector: None, state };
        encoder.transition_resources(std::iter::empty(), std::iter::once(back));
    }

    /// Waits for the submitted readback and returns one image per layer; none if the images are not
    /// readable.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<Vec<Pixels>, Fault> {
        self.readbacks.iter().map(|readback| readback.read(gpu)).collect()
    }
}
