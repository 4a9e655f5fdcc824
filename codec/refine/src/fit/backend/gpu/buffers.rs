//! The buffers of a fit: per Gaussian, per pixel, per splat-tile pair.

use bytemuck::Pod;
use shaders::fit::layout::{AdamUniforms, Response, Statistics, StepUniforms, Totals};
use shaders::fit::{
    BLOCK, CAMERA_NUMBERS, CHUNK, Columns, DIGIT_BITS, DIGITS, SPLAT_BYTES, SPLAT_NUMBERS, TILE, VIEW_BYTES,
};

use super::device::{Buffer, Device};
use crate::fit::backend::DeviceError;

/// Bytes per number.
const WORD: u64 = 4;

/// Significant bits of a sort key: the bits of a positive float, and a bit for keys behind all others.
pub(super) const DEPTH_BITS: u32 = 32;

/// The buffers that a sort alternates between.
pub(super) type PingPong = [Buffer; 2];

/// All buffers. The fields have the names in [`shaders::fit::binding`].
pub(super) struct Buffers {
    pub(super) fixed: Fixed,
    pub(super) gaussians: PerGaussian,
    pub(super) pixels: PerPixel,
    pub(super) pairs: Pairs,
    pub(super) scanned: Scanned,
}

impl Buffers {
    /// Rows of the drawn splats, front to back, after the sort by depth.
    pub(super) fn order(&self) -> &Buffer {
        &self.gaussians.rows[passes(DEPTH_BITS) % 2]
    }
}

/// Buffers of fixed size.
pub(super) struct Fixed {
    pub(super) uniforms: Buffer,
    pub(super) adam_uniforms: Buffer,
    pub(super) response: Buffer,
    pub(super) totals: Buffer,
    pub(super) d_camera: Buffer,
    /// For reading the totals back.
    pub(super) staging: Buffer,
}

/// Buffers per Gaussian.
pub(super) struct PerGaussian {
    /// Number of Gaussians.
    pub(super) count: u32,
    pub(super) columns: Columns,
    pub(super) parameters: Buffer,
    pub(super) first_moments: Buffer,
    pub(super) second_moments: Buffer,
    pub(super) d_parameters: Buffer,
    pub(super) statistics: Buffer,
    /// Nothing if cameras are not learned.
    pub(super) d_view: Buffer,
    pub(super) splats: Buffer,
    pub(super) keys: PingPong,
    pub(super) rows: PingPong,
}

/// Buffers per pixel, for the largest image so far.
pub(super) struct PerPixel {
    /// Capacity in pixels and in tiles.
    pub(super) pixels: u64,
    pub(super) tiles: u32,
    pub(super) image: Buffer,
    /// Nothing if cameras are not learned.
    pub(super) seen: Buffer,
    pub(super) photograph: Buffer,
    pub(super) blurred: Buffer,
    pub(super) derivatives: Buffer,
    pub(super) differences: Buffer,
    pub(super) d_image: Buffer,
    pub(super) tile_starts: Buffer,
}

/// Buffers per pair of a splat and a tile that it overlaps.
pub(super) struct Pairs {
    /// Capacity in pairs.
    pub(super) capacity: u32,
    pub(super) tiles: PingPong,
    pub(super) indices: PingPong,
    pub(super) rows: Buffer,
    pub(super) d_pairs: Buffer,
}

/// Buffers of scans and sorts.
pub(super) struct Scanned {
    pub(super) counts: Buffer,
    pub(super) block_sums: Buffer,
}

impl Fixed {
    pub(super) fn new(device: &Device) -> Result<Fixed, DeviceError> {
        Ok(Fixed {
            uniforms: device.uniform::<StepUniforms>()?,
            adam_uniforms: device.uniform::<AdamUniforms>()?,
            response: device.uniform::<Response>()?,
            totals: device.storage("the totals", bytes::<Totals>(1))?,
            d_camera: device.storage("the gradient of the camera", CAMERA_NUMBERS as u64 * WORD)?,
            staging: device.staging(bytes::<Totals>(1))?,
        })
    }
}

impl PerGaussian {
    pub(super) fn new(device: &Device, count: u32, columns: Columns) -> Result<PerGaussian, DeviceError> {
        let n = u64::from(count);
        let all = n * u64::from(columns.numbers()) * WORD;
        Ok(PerGaussian {
            count,
            columns,
            parameters: device.storage("the Gaussians", all)?,
            first_moments: device.storage("the moments", all)?,
            second_moments: device.storage("the moments", all)?,
            d_parameters: device.storage("the gradient", all)?,
            statistics: device.storage("the statistics of the Gaussians", bytes::<Statistics>(n))?,
            d_view: PerGaussian::d_view(device, count, columns)?,
            splats: device.storage("the splats", n * SPLAT_BYTES)?,
            keys: ping_pong(device, "the depths", n)?,
            rows: ping_pong(device, "the order of the splats", n)?,
        })
    }

    /// The gradient of the view, for `count` Gaussians.
    pub(super) fn d_view(device: &Device, count: u32, columns: Columns) -> Result<Buffer, DeviceError> {
        let bytes = if columns.learns_cameras { u64::from(count) * VIEW_BYTES } else { 0 };
        device.storage("the gradient of the view", bytes)
    }
}

impl PerPixel {
    /// The image as the camera shows it, for so many pixels.
    pub(super) fn seen(device: &Device, pixels: u64, learns_cameras: bool) -> Result<Buffer, DeviceError> {
        device.storage("the image", if learns_cameras { pixels * 4 * WORD } else { 0 })
    }

    /// Buffers for images of `size` and of all sizes that fit `before`.
    pub(super) fn new(
        device: &Device,
        size: [u32; 2],
        learns_cameras: bool,
        before: Option<&PerPixel>,
    ) -> Result<PerPixel, DeviceError> {
        let [x, y] = tiles(size);
        let pixels = (u64::from(size[0]) * u64::from(size[1])).max(before.map_or(0, |all| all.pixels));
        let tiles = (x * y).max(before.map_or(0, |all| all.tiles));
        Ok(PerPixel {
            pixels,
            tiles,
            image: device.storage("the image", pixels * 4 * WORD)?,
            seen: PerPixel::seen(device, pixels, learns_cameras)?,
            photograph: device.storage("the photograph", pixels * WORD)?,
            blurred: device.storage("the blurred image", pixels * 15 * WORD)?,
            derivatives: device.storage("the derivatives of the loss", pixels * 9 * WORD)?,
            differences: device.storage("the differences of the pixels", pixels * 2 * WORD)?,
            d_image: device.storage("the gradient of the image", pixels * 4 * WORD)?,
            tile_starts: device.storage("the tiles", (u64::from(tiles) + 1) * WORD)?,
        })
    }

    pub(super) fn fits(&self, size: [u32; 2]) -> bool {
        let [x, y] = tiles(size);
        u64::from(size[0]) * u64::from(size[1]) <= self.pixels && x * y <= self.tiles
    }
}

impl Pairs {
    /// Name in errors.
    pub(super) const WHAT: &'static str = "the pairs of Gaussians and tiles";

    /// Bytes per pair in the largest buffer.
    pub(super) const LARGEST: u64 = SPLAT_NUMBERS as u64 * WORD;

    pub(super) fn new(device: &Device, capacity: u32) -> Result<Pairs, DeviceError> {
        let n = u64::from(capacity);
        Ok(Pairs {
            capacity,
            tiles: ping_pong(device, Pairs::WHAT, n)?,
            indices: ping_pong(device, Pairs::WHAT, n)?,
            rows: device.storage(Pairs::WHAT, n * WORD)?,
            d_pairs: device.storage(Pairs::WHAT, n * Pairs::LARGEST)?,
        })
    }
}

impl Scanned {
    /// Buffers to sort or scan up to `longest` numbers.
    pub(super) fn new(device: &Device, longest: u32) -> Result<Scanned, DeviceError> {
        let digits = u64::from(DIGITS) * u64::from(longest.div_ceil(CHUNK));
        let counts = digits.max(longest.into());
        let blocks = counts.div_ceil(u64::from(BLOCK));
        Ok(Scanned {
            counts: device.storage("the counts of a sort", counts * WORD)?,
            block_sums: device.storage("the sums of a sort", blocks * WORD)?,
        })
    }
}

/// Digits of numbers of `bits` bits, that is passes of a sort.
pub(super) fn passes(bits: u32) -> usize {
    bits.div_ceil(DIGIT_BITS) as usize
}

/// Tiles of an image along either axis.
pub(super) fn tiles(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE))
}

fn ping_pong(device: &Device, what: &'static str, numbers: u64) -> Result<PingPong, DeviceError> {
    Ok([device.storage(what, numbers * WORD)?, device.storage(what, numbers * WORD)?])
}

fn bytes<T: Pod>(count: u64) -> u64 {
    count * size_of::<T>() as u64
}
