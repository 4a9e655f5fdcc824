//! [`Picture`]: the image below the user interface, cached so that it is drawn only when it changes.

use program::Fault;

use super::device::Gpu;
use super::surface::{Format, SurfaceFrame};

/// An image of the size of a window.
pub(crate) struct Picture {
    texture: wgpu::Texture,
    /// Render target.
    pub(crate) view: wgpu::TextureView,
    /// Width and height in pixels.
    pub(crate) size: [u32; 2],
}

impl Picture {
    /// An image of `size` for windows of `format`.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub(crate) fn new(gpu: &Gpu, format: Format, size: [u32; 2]) -> Result<Picture, Fault> {
        let texture = gpu.allocate("the picture", || {
            gpu.image("picture", size.into(), 1, format, wgpu::TextureUsages::COPY_SRC)
        })?;
        Ok(Picture { view: texture.create_view(&Default::default()), texture, size })
    }

    /// Records a copy of the image to `frame`, which has the same size.
    pub(crate) fn show(&self, encoder: &mut wgpu::CommandEncoder, frame: &SurfaceFrame) {
        let (from, to) = (self.texture.as_image_copy(), frame.texture().as_image_copy());
        encoder.copy_texture_to_texture(from, to, self.texture.size());
    }
}
