//! [`Readback`]: copies one layer of an image from the GPU into [`Pixels`].

use glam::UVec2;
use half::f16;
use program::Fault;

use super::device::Gpu;

/// An image in CPU memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height in pixels.
    pub size: UVec2,
    /// Rows from the top: red, green, blue premultiplied by alpha, and alpha. Display-referred,
    /// nominally 0 to 1. Images of a headset's panel are premultiplied in linear light.
    pub rgba: Vec<[f32; 4]>,
}

impl Pixels {
    /// The upper left corner, `size` pixels at most.
    #[cfg(feature = "xr")]
    pub(crate) fn corner(&self, size: UVec2) -> Pixels {
        let size = size.min(self.size);
        let rows = self.rgba.chunks(self.size.x.max(1) as usize).take(size.y as usize);
        Pixels { size, rgba: rows.flat_map(|row| &row[..size.x as usize]).copied().collect() }
    }

    /// The image over black in 8 bits per channel: `size.x * size.y * 3` bytes.
    pub fn to_rgb8(&self) -> Vec<u8> {
        let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
        self.rgba.iter().flat_map(|&[r, g, b, _]| [byte(r), byte(g), byte(b)]).collect()
    }
}

/// A buffer for one layer of an image.
pub(super) struct Readback {
    size: UVec2,
    format: wgpu::TextureFormat,
    buffer: wgpu::Buffer,
}

impl Readback {
    /// A buffer for images of `size` pixels with `format`, 8 bits or 16-bit float per channel.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is not enough memory.
    pub(super) fn new(gpu: &Gpu, size: UVec2, format: wgpu::TextureFormat) -> Result<Readback, Fault> {
        let bytes = u64::from(bytes_per_row(size.x, format)) * u64::from(size.y);
        gpu.allocate("reading an image back", || Readback {
            size,
            format,
            buffer: gpu.empty_buffer(
                "readback",
                bytes,
                wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            ),
        })
    }

    /// Records a copy of a layer of `texture`.
    pub(super) fn record(&self, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture, layer: u32) {
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &self.buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(bytes_per_row(self.size.x, self.format)),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width: self.size.x, height: self.size.y, depth_or_array_layers: 1 },
        );
    }

    /// Waits for the submitted copy and returns its pixels.
    ///
    /// # Errors
    /// [`Fault::Device`] if the device was lost.
    pub(super) fn read(&self, gpu: &Gpu) -> Result<Pixels, Fault> {
        self.buffer.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        gpu.wait()?;
        let mapped = self.buffer.slice(..).get_mapped_range().map_err(|error| {
            Fault::Device(format!("graphics device {}: {error}: start again", gpu.adapter_name))
        })?;
        let row_bytes = (self.size.x * bytes_per_pixel(self.format)) as usize;
        let rows =
            mapped.chunks(bytes_per_row(self.size.x, self.format) as usize).map(|row| &row[..row_bytes]);
        let eight = |order: [usize; 4]| {
            let pixels = rows.clone().flat_map(|row| row.chunks_exact(4));
            pixels.map(|pixel| order.map(|c| f32::from(pixel[c]) / 255.0)).collect()
        };
        let rgba = match self.format {
            wgpu::TextureFormat::Rgba16Float => rows
                .flat_map(|row| row.chunks_exact(8))
                .map(|pixel| {
                    std::array::from_fn(|c| f16::from_le_bytes([pixel[2 * c], pixel[2 * c + 1]]).to_f32())
                })
                .collect(),
            wgpu::TextureFormat::Bgra8Unorm => eight([2, 1, 0, 3]),
            _ => eight([0, 1, 2, 3]),
        };
        drop(mapped);
        self.buffer.unmap();
        Ok(Pixels { size: self.size, rgba })
    }
}

fn bytes_per_pixel(format: wgpu::TextureFormat) -> u32 {
    if format == wgpu::TextureFormat::Rgba16Float { 8 } else { 4 }
}

/// Row pitch in bytes of a readback buffer.
pub(super) fn bytes_per_row(width: u32, format: wgpu::TextureFormat) -> u32 {
    (width * bytes_per_pixel(format)).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}
