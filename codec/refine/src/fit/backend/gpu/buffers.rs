//! The buffers of a fit: per Gaussian, per pixel, per splat-tile pair.

use bytemuck::Pod;
use shaders::fit::layout::{AdamUniforms, Response, Statistics, StepUniforms, Totals};
use shaders::fit::{
    CAMERA_NUMBERS, Columns, DIGIT_BITS, DIGITS, GROUP, SPLAT_BYTES, SPLAT_NUMBERS, SUM_GROUP, TILE,
    TILE_NUMBERS, VIEW_BYTES,
};

use super::device::{Buffer, Device};
use crate::fit::backend::DeviceError;

/// Steps in flight behind the oldest: the device has work while the host prepares more.
pub(super) const IN_FLIGHT: usize = 2;

/// Largest number of groups that take parts of a series to sort: each reads the counts of all.
pub(super) const PARTS_MAX: u32 = 256;

/// Bytes per number.
const WORD: u64 = 4;

/// Significant bits of a sort key: the bits of a positive float, and a bit for keys behind all others.
pub(super) const DEPTH_BITS: u32 = 32;

/// The buffers that a sort alternates between.
pub(super) type PingPong = [Buffer; 2];

/// Buffers that the steps in flight take in turn.
pub(super) type InTurn = [Buffer; IN_FLIGHT + 1];

/// All buffers. The fields have the names in [`shaders::fit::binding`].
pub(super) struct Buffers {
    pub(super) fixed: Fixed,
    pub(super) gaussians: PerGaussian,
    pub(super) pixels: PerPixel,
    pub(super) pairs: Pairs,
}

impl Buffers {
    /// Bits of a tile index, or of the number of tiles, which stands for no tile.
    pub(super) fn tile_bits(&self) -> u32 {
        u32::BITS - self.pixels.tiles.leading_zeros()
    }

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
    pub(super) counts: Buffer,
    /// For reading back the totals and the gradient of the camera: of a step in turn.
    pub(super) results: InTurn,
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
    pub(super) view_sums: Buffer,
    pub(super) splats: Buffer,
    pub(super) keys: PingPong,
    pub(super) rows: PingPong,
    pub(super) block_sums: Buffer,
}

/// Buffers per pixel, for the largest image so far.
pub(super) struct PerPixel {
    /// Capacity in pixels and in tiles.
    pub(super) pixels: u64,
    pub(super) tiles: u32,
    pub(super) image: Buffer,
    pub(super) photograph: Buffer,
    /// The photographs of the steps in flight.
    pub(super) photographs: InTurn,
    pub(super) derivatives: Buffer,
    pub(super) d_image: Buffer,
    pub(super) tile_starts: Buffer,
    pub(super) tile_sums: Buffer,
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

impl Fixed {
    pub(super) fn new(device: &Device) -> Result<Fixed, DeviceError> {
        Ok(Fixed {
            uniforms: device.uniform::<StepUniforms>()?,
            adam_uniforms: device.uniform::<AdamUniforms>()?,
            response: device.uniform::<Response>()?,
            totals: device.storage("the totals", bytes::<Totals>(1))?,
            d_camera: device.storage("the gradient of the camera", CAMERA_NUMBERS as u64 * WORD)?,
            counts: device.storage("the counts of a sort", u64::from(PARTS_MAX * DIGITS) * WORD)?,
            results: in_turn(|| device.staging(Fixed::RESULT_BYTES))?,
        })
    }

    /// Size of the totals and the gradient of the camera.
    const RESULT_BYTES: u64 = size_of::<Totals>() as u64 + CAMERA_NUMBERS as u64 * WORD;
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
            view_sums: device
                .storage("the gradient of the view", u64::from(count.div_ceil(GROUP)) * VIEW_BYTES)?,
            splats: device.storage("the splats", n * SPLAT_BYTES)?,
            keys: ping_pong(device, "the depths", n)?,
            rows: ping_pong(device, "the order of the splats", n)?,
            block_sums: device
                .storage("the tiles of the splats", u64::from(count.div_ceil(SUM_GROUP)) * WORD)?,
        })
    }
}

impl PerPixel {
    /// Buffers for images of `size` and of all sizes that fit `before`.
    pub(super) fn new(
        device: &Device,
        size: [u32; 2],
        before: Option<&PerPixel>,
    ) -> Result<PerPixel, DeviceError> {
        let [x, y] = tiles(size);
        let pixels = (u64::from(size[0]) * u64::from(size[1])).max(before.map_or(0, |all| all.pixels));
        let tiles = (x * y).max(before.map_or(0, |all| all.tiles));
        Ok(PerPixel {
            pixels,
            tiles,
            image: device.storage("the image", pixels * 4 * WORD)?,
            photograph: device.storage("the photograph", pixels * WORD)?,
            photographs: in_turn(|| device.storage("the photograph", pixels * WORD))?,
            derivatives: device.storage("the derivatives of the loss", pixels * 9 * WORD)?,
            d_image: device.storage("the gradient of the image", pixels * 4 * WORD)?,
            tile_starts: device.storage("the tiles", (u64::from(tiles) + 1) * WORD)?,
            tile_sums: device.storage("the sums of the tiles", u64::from(tiles * TILE_NUMBERS) * WORD)?,
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

fn in_turn(mut make: impl FnMut() -> Result<Buffer, DeviceError>) -> Result<InTurn, DeviceError> {
    Ok([make()?, make()?, make()?])
}

fn bytes<T: Pod>(count: u64) -> u64 {
    count * size_of::<T>() as u64
}
