//! [`Offscreen`]: a render target with one layer per eye that can be read back.

use clap::ValueEnum;
use glam::UVec2;
use program::Fault;

use super::counts::FrameCounts;
use super::device::Gpu;
use super::foveation::Foveation;
use super::layers::layer_views;
use super::readback::{Pixels, Readback, bytes_per_row};
use super::renderer::Renderer;
use super::settings::RenderSettings;
use super::stages::linear_light::LinearLight;
use crate::view::View;

/// Bits per channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ChannelDepth {
    /// 8-bit unsigned, as on displays.
    #[value(name = "8")]
    Eight,
    /// 16-bit float: blends many translucent layers without rounding each to 1/255.
    #[value(name = "16")]
    Sixteen,
}

impl ChannelDepth {
    /// The texture format.
    pub fn format(self) -> wgpu::TextureFormat {
        match self {
            ChannelDepth::Eight => wgpu::TextureFormat::Rgba8Unorm,
            ChannelDepth::Sixteen => wgpu::TextureFormat::Rgba16Float,
        }
    }
}

/// An image in GPU memory with one layer per eye.
pub struct Offscreen {
    layers: u32,
    texture: wgpu::Texture,
    /// Readback buffer for one layer.
    readback: Readback,
    foveation: Option<Foveation>,
    linear: Option<LinearLight>,
}

impl Offscreen {
    /// Creates an image of `size` pixels with `layers` layers.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the size is 0 or exceeds the limits of the device, [`Fault::Device`] if there is
    /// not enough memory.
    pub fn new(gpu: &Gpu, size: UVec2, layers: u32, depth: ChannelDepth) -> Result<Offscreen, Fault> {
        let side = gpu.caps.max_image_side;
        if size.min_element() == 0 || size.max_element() > side {
            return Err(Fault::Usage(format!(
                "image size {}x{}: {} draws 1x1 to {side}x{side} pixels: give another --size",
                size.x, size.y, gpu.adapter_name
            )));
        }
        let row = bytes_per_row(size.x, depth.format());
        let bytes = u64::from(row) * u64::from(size.y);
        if bytes > gpu.device.limits().max_buffer_size {
            return Err(Fault::Usage(format!(
                "image size {}x{}: {} cannot read back more than {} MiB: give a smaller --size",
                size.x,
                size.y,
                gpu.adapter_name,
                gpu.device.limits().max_buffer_size >> 20
            )));
        }
        let readback = Readback::new(gpu, size, depth.format())?;
        gpu.allocate("the image", || Offscreen {
            layers,
            texture: gpu.image("offscreen", size, layers, depth.format(), wgpu::TextureUsages::COPY_SRC),
            readback,
            foveation: None,
            linear: None,
        })
    }

    /// The image with what foveated frames need, with insets of up to `side_max`, see [`Foveation::new`].
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub fn foveated(mut self, gpu: &Gpu, side_max: f32) -> Result<Offscreen, Fault> {
        let size = UVec2::new(self.texture.width(), self.texture.height());
        let eyes = self.layers as usize;
        self.foveation = Some(Foveation::new(gpu, self.texture.format(), eyes, size, side_max)?);
        Ok(self)
    }

    /// The image with colours as a compositor takes them that blends in linear light. Call it after
    /// [`Offscreen::foveated`].
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub fn in_linear_light(mut self, gpu: &Gpu) -> Result<Offscreen, Fault> {
        let size = UVec2::new(self.texture.width(), self.texture.height());
        self.linear = Some(LinearLight::new(gpu, self.texture.format(), self.layers, size)?);
        self.foveation = self.foveation.map(|foveation| foveation.for_linear_light(gpu)).transpose()?;
        Ok(self)
    }

    /// Render targets for a renderer with `eyes_per_pass`, one per pass.
    pub fn targets(&self, eyes_per_pass: u32) -> Vec<wgpu::TextureView> {
        layer_views(&self.texture, self.texture.format(), eyes_per_pass)
    }

    /// Draws a frame into the image and waits for the GPU.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    ///
    /// # Panics
    /// As [`Renderer::prepare`] and [`Renderer::record`].
    pub fn render(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        t: f64,
        views: &[View],
        settings: &RenderSettings,
    ) -> Result<FrameCounts, Fault> {
        let counts = self.submit(gpu, renderer, t, views, settings);
        gpu.wait()?;
        Ok(counts)
    }

    /// Submits a frame as [`Offscreen::render`] does, without waiting for the GPU.
    ///
    /// # Panics
    /// As for [`Offscreen::render`].
    pub fn submit(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        t: f64,
        views: &[View],
        settings: &RenderSettings,
    ) -> FrameCounts {
        let mut encoder = gpu.encoder();
        let targets = self.targets(renderer.eyes_per_pass());
        let counts = renderer.prepare(gpu, t, views, settings);
        renderer.record(gpu, &mut encoder, &targets, self.foveation.as_ref(), self.linear.as_ref());
        gpu.submit(encoder);
        counts
    }

    /// Reads all layers back.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Pixels>, Fault> {
        (0..self.layers).map(|layer| self.read_layer(gpu, layer)).collect()
    }

    fn read_layer(&self, gpu: &Gpu, layer: u32) -> Result<Pixels, Fault> {
        let mut encoder = gpu.encoder();
        self.readback.record(&mut encoder, &self.texture, layer);
        gpu.submit(encoder);
        self.readback.read(gpu)
    }
}
