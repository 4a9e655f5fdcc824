//! [`Offscreen`]: an image to draw into and read back, one layer per eye.

use clap::ValueEnum;
use glam::UVec2;
use half::f16;

use super::device::Gpu;
use super::renderer::{FrameCounts, Renderer};
use super::settings::Settings;
use crate::fault::Fault;
use crate::view::View;

/// Bits per channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Depth {
    /// 8-bit unsigned: what displays take.
    #[value(name = "8")]
    Eight,
    /// 16-bit float: adds up many faint layers without rounding each to 1/255.
    #[value(name = "16")]
    Sixteen,
}

impl Depth {
    /// The format of the graphics API.
    pub fn format(self) -> wgpu::TextureFormat {
        match self {
            Depth::Eight => wgpu::TextureFormat::Rgba8Unorm,
            Depth::Sixteen => wgpu::TextureFormat::Rgba16Float,
        }
    }

    fn bytes_per_pixel(self) -> u32 {
        match self {
            Depth::Eight => 4,
            Depth::Sixteen => 8,
        }
    }
}

/// An image that was read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height.
    pub size: UVec2,
    /// Rows from the top: red, green, blue premultiplied by alpha, and alpha. Display-referred,
    /// nominally 0 to 1.
    pub rgba: Vec<[f32; 4]>,
}

impl Pixels {
    /// The colours over black as bytes, red, green, blue: `size.x * size.y * 3`.
    pub fn to_rgb8(&self) -> Vec<u8> {
        let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
        self.rgba.iter().flat_map(|&[r, g, b, _]| [byte(r), byte(g), byte(b)]).collect()
    }
}

/// An image in GPU memory with one layer per eye.
pub struct Offscreen {
    size: UVec2,
    layers: u32,
    depth: Depth,
    texture: wgpu::Texture,
    /// One layer, read back.
    readback: wgpu::Buffer,
}

impl Offscreen {
    /// An image of `size` pixels for `layers` eyes.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it is empty or larger than the device allows, [`Fault::Device`] if there
    /// is not enough memory.
    pub fn new(gpu: &Gpu, size: UVec2, layers: u32, depth: Depth) -> Result<Offscreen, Fault> {
        let side = gpu.caps.max_image_side;
        if size.min_element() == 0 || size.max_element() > side {
            return Err(Fault::Usage(format!(
                "image size {}x{}: {} draws 1x1 to {side}x{side} pixels",
                size.x, size.y, gpu.adapter_name
            )));
        }
        let row = bytes_per_row(size.x, depth);
        let bytes = u64::from(row) * u64::from(size.y);
        if bytes > gpu.device.limits().max_buffer_size {
            return Err(Fault::Usage(format!(
                "image size {}x{}: {} cannot read back more than {} MiB",
                size.x,
                size.y,
                gpu.adapter_name,
                gpu.device.limits().max_buffer_size >> 20
            )));
        }
        gpu.allocate("the image", || Offscreen {
            size,
            layers,
            depth,
            texture: gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("offscreen"),
                size: wgpu::Extent3d { width: size.x, height: size.y, depth_or_array_layers: layers },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: depth.format(),
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            }),
            readback: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size: bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
        })
    }

    /// What the passes of a renderer draw into: one view of all layers for passes of several eyes,
    /// else one of each layer.
    pub fn targets(&self, eyes_per_pass: u32) -> Vec<wgpu::TextureView> {
        (0..self.layers)
            .step_by(eyes_per_pass as usize)
            .map(|layer| {
                self.texture.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(match eyes_per_pass {
                        1 => wgpu::TextureViewDimension::D2,
                        _ => wgpu::TextureViewDimension::D2Array,
                    }),
                    base_array_layer: layer,
                    array_layer_count: Some(eyes_per_pass),
                    ..Default::default()
                })
            })
            .collect()
    }

    /// Draws a frame into the image and waits until it is done.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    ///
    /// # Panics
    /// As [`Renderer::draw`].
    pub fn render(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        t: f64,
        views: &[View],
        settings: &Settings,
    ) -> Result<FrameCounts, Fault> {
        let mut encoder = gpu.encoder();
        let targets = self.targets(renderer.eyes_per_pass());
        let counts = renderer.draw(gpu, &mut encoder, t, views, settings, &targets);
        gpu.submit(encoder);
        gpu.wait()?;
        Ok(counts)
    }

    /// Reads all layers back.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Pixels>, Fault> {
        (0..self.layers).map(|layer| self.read_layer(gpu, layer)).collect()
    }

    fn read_layer(&self, gpu: &Gpu, layer: u32) -> Result<Pixels, Fault> {
        let bytes_per_row = bytes_per_row(self.size.x, self.depth);
        let mut encoder = gpu.encoder();
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture: &self.texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &self.readback,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(bytes_per_row),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width: self.size.x, height: self.size.y, depth_or_array_layers: 1 },
        );
        gpu.submit(encoder);
        self.readback.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        gpu.wait()?;
        let mapped = self
            .readback
            .slice(..)
            .get_mapped_range()
            .map_err(|error| Fault::Device(format!("graphics device {}: {error}", gpu.adapter_name)))?;
        let row_bytes = (self.size.x * self.depth.bytes_per_pixel()) as usize;
        let rows = mapped.chunks(bytes_per_row as usize).map(|row| &row[..row_bytes]);
        let rgba = match self.depth {
            Depth::Eight => rows
                .flat_map(|row| row.chunks_exact(4))
                .map(|pixel| std::array::from_fn(|c| f32::from(pixel[c]) / 255.0))
                .collect(),
            Depth::Sixteen => rows
                .flat_map(|row| row.chunks_exact(8))
                .map(|pixel| {
                    std::array::from_fn(|c| f16::from_le_bytes([pixel[2 * c], pixel[2 * c + 1]]).to_f32())
                })
                .collect(),
        };
        drop(mapped);
        self.readback.unmap();
        Ok(Pixels { size: self.size, rgba })
    }
}

/// Bytes from row to row of an image that is read back.
fn bytes_per_row(width: u32, depth: Depth) -> u32 {
    (width * depth.bytes_per_pixel()).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}
