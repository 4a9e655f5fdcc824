//! What a fit keeps in the memory of a device: by Gaussian, by pixel, by pair of a splat and a tile.

use bytemuck::Pod;
use shaders::fit::layout::{AdamUniforms, Memory, State, StepUniforms};
use shaders::fit::{BLOCK, CHUNK, Columns, DIGITS, SPLAT_BYTES, SPLAT_NUMBERS, TILE};

use super::device::{Buffer, Device};
use crate::fit::backend::DeviceError;

/// Bytes of a number.
const WORD: u64 = 4;

/// Two buffers between which a sort goes back and forth.
pub(super) type Pair = [Buffer; 2];

/// What does not depend on a size.
pub(super) struct Fixed {
    pub(super) step: Buffer,
    pub(super) pace: Buffer,
    pub(super) state: Buffer,
    /// Where the state lands.
    pub(super) landing: Buffer,
}

/// A number, or several, for each Gaussian. The names are those of [`shaders::fit::binding`].
pub(super) struct PerGaussian {
    /// Number of Gaussians.
    pub(super) count: u32,
    pub(super) columns: Columns,
    pub(super) parameters: Buffer,
    pub(super) first_moments: Buffer,
    pub(super) second_moments: Buffer,
    pub(super) d_parameters: Buffer,
    pub(super) memory: Buffer,
    pub(super) splats: Buffer,
    pub(super) keys: Pair,
    pub(super) rows: Pair,
}

/// A number, or several, for each pixel of the largest image so far.
pub(super) struct PerPixel {
    /// Pixels and tiles for which there is room.
    pub(super) pixels: u64,
    pub(super) tiles: u32,
    pub(super) picture: Buffer,
    pub(super) photograph: Buffer,
    pub(super) blurred: Buffer,
    pub(super) derivatives: Buffer,
    pub(super) differences: Buffer,
    pub(super) d_picture: Buffer,
    pub(super) tile_starts: Buffer,
}

/// The pairs of a splat and a tile that it reaches.
pub(super) struct Pairs {
    /// Pairs for which there is room.
    pub(super) capacity: u32,
    pub(super) tiles: Pair,
    pub(super) numbers: Pair,
    pub(super) rows: Buffer,
    pub(super) d_pairs: Buffer,
}

/// What is scanned.
pub(super) struct Scanned {
    pub(super) counts: Buffer,
    pub(super) block_sums: Buffer,
}

impl Fixed {
    pub(super) fn new(device: &Device) -> Result<Fixed, DeviceError> {
        Ok(Fixed {
            step: device.uniform::<StepUniforms>()?,
            pace: device.uniform::<AdamUniforms>()?,
            state: device.room("the state", bytes::<State>(1))?,
            landing: device.landing(bytes::<State>(1))?,
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
            parameters: device.room("the Gaussians", all)?,
            first_moments: device.room("the moments", all)?,
            second_moments: device.room("the moments", all)?,
            d_parameters: device.room("the gradient", all)?,
            memory: device.room("the statistics of the Gaussians", bytes::<Memory>(n))?,
            splats: device.room("the splats", n * SPLAT_BYTES)?,
            keys: pair(device, "the depths", n)?,
            rows: pair(device, "the order of the splats", n)?,
        })
    }
}

impl PerPixel {
    /// Room for images of `size`, and for what there was room for `before`.
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
            picture: device.room("the picture", pixels * 4 * WORD)?,
            photograph: device.room("the photograph", pixels * WORD)?,
            blurred: device.room("the blurred picture", pixels * 15 * WORD)?,
            derivatives: device.room("the derivatives of the loss", pixels * 9 * WORD)?,
            differences: device.room("the differences of the pixels", pixels * 2 * WORD)?,
            d_picture: device.room("the gradient by the picture", pixels * 4 * WORD)?,
            tile_starts: device.room("the tiles", (u64::from(tiles) + 1) * WORD)?,
        })
    }

    pub(super) fn has_room(&self, size: [u32; 2]) -> bool {
        let [x, y] = tiles(size);
        u64::from(size[0]) * u64::from(size[1]) <= self.pixels && x * y <= self.tiles
    }
}

impl Pairs {
    /// What they are called in errors.
    pub(super) const WHAT: &'static str = "the pairs of Gaussians and tiles";

    /// Bytes of a pair in the largest buffer.
    pub(super) const LARGEST: u64 = SPLAT_NUMBERS as u64 * WORD;

    pub(super) fn new(device: &Device, capacity: u32) -> Result<Pairs, DeviceError> {
        let n = u64::from(capacity);
        Ok(Pairs {
            capacity,
            tiles: pair(device, Pairs::WHAT, n)?,
            numbers: pair(device, Pairs::WHAT, n)?,
            rows: device.room(Pairs::WHAT, n * WORD)?,
            d_pairs: device.room(Pairs::WHAT, n * Pairs::LARGEST)?,
        })
    }
}

impl Scanned {
    /// Room to sort `longest` numbers, and to scan as many.
    pub(super) fn new(device: &Device, longest: u32) -> Result<Scanned, DeviceError> {
        let digits = u64::from(DIGITS) * u64::from(longest.div_ceil(CHUNK));
        let counts = digits.max(longest.into());
        let blocks = counts.div_ceil(u64::from(BLOCK));
        Ok(Scanned {
            counts: device.room("the counts of a sort", counts * WORD)?,
            block_sums: device.room("the sums of a sort", blocks * WORD)?,
        })
    }
}

/// Tiles of an image along either side.
pub(super) fn tiles(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE))
}

fn pair(device: &Device, what: &'static str, numbers: u64) -> Result<Pair, DeviceError> {
    Ok([device.room(what, numbers * WORD)?, device.room(what, numbers * WORD)?])
}

fn bytes<T: Pod>(count: u64) -> u64 {
    count * size_of::<T>() as u64
}
