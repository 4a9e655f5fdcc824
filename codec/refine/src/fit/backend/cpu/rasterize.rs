//! Stage `rasterize`: composites splats into pixels, front to back (the paper's rendering equation).
//!
//! Tiles are independent and run in parallel. Within a tile, each splat is added to the blocks of 4x4 pixels
//! that it reaches and that are not saturated. The loop over a block has no branches, so the compiler
//! vectorises it.

use codec::ALPHA_MIN;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::bin::{TILE, Tiles};
use super::project::Splat;
use crate::fit::precision::Real;
use crate::fit::views::RenderedImage;

/// Largest alpha of a fragment.
pub(in crate::fit) const ALPHA_MAX: f64 = 0.999;

/// A pixel is saturated before the fragment that would lower its transmittance to this.
pub(in crate::fit) const TRANSMITTANCE_MIN: f64 = 1e-4;

/// Splats between checks which blocks are saturated.
const ROUND: usize = 32;

/// Side of a block in pixels.
const BLOCK: usize = 4;

/// Pixels in a block: as many lanes as the widest vectors have. In blocks of 16x1 pixels, two thirds of the lanes
/// would be outside a splat of a typical size.
pub(super) const LANES: usize = BLOCK * BLOCK;

/// Blocks in a tile.
pub(super) const BLOCKS: usize = (TILE / BLOCK) * (TILE / BLOCK);

/// One number per pixel of a block, row by row.
pub(super) type Lanes<T> = [T; LANES];

/// A splat that was drawn in a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DrawnSplat {
    /// Index of the splat.
    pub(super) index: u32,
    /// Bit `b` is set if the splat was drawn in block `b` of the tile.
    pub(super) blocks: u32,
}

/// Column and row in a tile of the pixel at `lane` of `block`.
#[inline(always)]
pub(super) fn pixel_of(block: usize, lane: usize) -> [usize; 2] {
    let across = TILE / BLOCK;
    [block % across * BLOCK + lane % BLOCK, block / across * BLOCK + lane / BLOCK]
}

/// Composites splats, which are sorted front to back. Returns the image and, per tile, the splats that were drawn
/// before their pixels were saturated. The result does not depend on the vector width of `arch`.
pub(super) fn rasterize<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    width: u32,
    height: u32,
) -> (RenderedImage<T>, Vec<Vec<DrawnSplat>>) {
    let size = [width as usize, height as usize];
    let composite = |tile| {
        arch.dispatch(Composite { splats, order: tiles.splats(tile), corner: tiles.corner(tile), size })
    };
    let drawn: Vec<_> = (0..tiles.len()).into_par_iter().map(composite).collect();
    let mut pixels = vec![[T::zero(); 4]; size[0] * size[1]];
    let bands = pixels.par_chunks_mut(TILE * size[0]).zip(drawn.par_chunks(size[0].div_ceil(TILE)));
    bands.for_each(|(band, tiles)| {
        let rows = band.len() / size[0];
        for (column, (blocks, _)) in tiles.iter().enumerate() {
            for (block, pixels) in blocks.iter().enumerate() {
                for lane in 0..LANES {
                    let [x, y] = pixel_of(block, lane);
                    let x = column * TILE + x;
                    if x < size[0] && y < rows {
                        band[y * size[0] + x] = pixels.at(lane);
                    }
                }
            }
        }
    });
    (RenderedImage { width, height, pixels }, drawn.into_iter().map(|(_, drawn)| drawn).collect())
}

/// Composites one tile.
struct Composite<'a, T> {
    splats: &'a [Splat<T>],
    order: &'a [u32],
    corner: [usize; 2],
    size: [usize; 2],
}

/// The colours of a block: red, green, blue, alpha.
#[derive(Clone, Copy)]
struct BlockColors<T> {
    channels: [Lanes<T>; 4],
}

impl<T: Real> BlockColors<T> {
    fn at(&self, lane: usize) -> [T; 4] {
        [0, 1, 2, 3].map(|channel| self.channels[channel][lane])
    }
}

impl<T: Real> NullaryFnOnce for Composite<'_, T> {
    /// The colours of the blocks, none if there are no splats, and the splats that were drawn.
    type Output = (Vec<BlockColors<T>>, Vec<DrawnSplat>);

    #[inline(always)]
    fn call(self) -> Self::Output {
        if self.order.is_empty() {
            return (Vec::new(), Vec::new());
        }
        let mut colors = vec![BlockColors { channels: [[T::zero(); LANES]; 4] }; BLOCKS];
        let mut transmittance = Transmittance::new(self.corner, self.size);
        let mut drawn = Vec::with_capacity(self.order.len());
        let grid = Grid::new();
        let mut open = 0;
        for (count, index) in self.order.iter().enumerate() {
            if count % ROUND == 0 {
                open = transmittance.open();
                if open == 0 {
                    break;
                }
            }
            let splat = &self.splats[*index as usize];
            let tile_splat = TileSplat::new(splat, self.corner, &grid);
            let blocks = tile_splat.blocks(&grid) & open;
            if blocks == 0 {
                continue;
            }
            drawn.push(DrawnSplat { index: *index, blocks });
            let mut rest = blocks;
            while rest != 0 {
                let block = rest.trailing_zeros() as usize % BLOCKS;
                rest &= rest - 1;
                add(&tile_splat.at(block), &grid, &mut transmittance.blocks[block], &mut colors[block]);
            }
        }
        (colors, drawn)
    }
}

/// Adds a splat to a block.
#[inline(always)]
fn add<T: Real>(
    splat: &SplatBlock<T>,
    grid: &Grid<T>,
    transmittance: &mut Lanes<T>,
    colors: &mut BlockColors<T>,
) {
    let [red, green, blue, alpha] = &mut colors.channels;
    for x in 0..LANES {
        let fragment = splat.fragment(grid, x, transmittance[x]);
        transmittance[x] = fragment.transmittance_behind;
        red[x] += fragment.weight * splat.color[0];
        green[x] += fragment.weight * splat.color[1];
        blue[x] += fragment.weight * splat.color[2];
        alpha[x] += fragment.weight;
    }
}

/// Transmittance of the pixels of a tile.
pub(super) struct Transmittance<T> {
    /// Block by block; 0 if a pixel is saturated or outside the image.
    pub(super) blocks: [Lanes<T>; BLOCKS],
}

impl<T: Real> Transmittance<T> {
    #[inline(always)]
    pub(super) fn new(corner: [usize; 2], size: [usize; 2]) -> Transmittance<T> {
        let pixel = |block: usize, lane: usize| {
            let [x, y] = pixel_of(block, lane);
            if corner[0] + x < size[0] && corner[1] + y < size[1] { T::one() } else { T::zero() }
        };
        Transmittance { blocks: std::array::from_fn(|block| std::array::from_fn(|lane| pixel(block, lane))) }
    }

    /// Bit `b` is set if block `b` has a pixel that is not saturated.
    #[inline(always)]
    fn open(&self) -> u32 {
        let mut open = 0;
        for (block, lanes) in self.blocks.iter().enumerate() {
            let mut most = T::zero();
            for lane in lanes {
                most += *lane;
            }
            open |= u32::from(most > T::zero()) << block;
        }
        open
    }
}

/// Positions in a tile that do not depend on the splat.
pub(super) struct Grid<T> {
    /// Column and row of each pixel of a block.
    pixels: [Lanes<T>; 2],
    /// Column and row of the centre of each block, from the centre of the tile's first pixel.
    centers: [[T; BLOCKS]; 2],
}

impl<T: Real> Grid<T> {
    #[inline(always)]
    pub(super) fn new() -> Grid<T> {
        let center = 0.5 * (BLOCK - 1) as f64;
        let number = |axis: usize, block: usize, lane: usize| pixel_of(block, lane)[axis] as f64;
        Grid {
            pixels: [0, 1].map(|axis| std::array::from_fn(|lane| T::from_f64(number(axis, 0, lane)))),
            centers: [0, 1]
                .map(|axis| std::array::from_fn(|block| T::from_f64(number(axis, block, 0) + center))),
        }
    }
}

/// A splat relative to a tile.
pub(super) struct TileSplat<'a, T> {
    splat: &'a Splat<T>,
    /// The centre of the tile's first pixel, from the splat's centre.
    first: [T; 2],
    /// `d.x - shear d.y` of a block's pixels, minus its value at the first pixel.
    slant: Lanes<T>,
}

/// A splat relative to a block.
pub(super) struct SplatBlock<'a, T> {
    pub(super) color: [T; 3],
    opacity: T,
    slant: &'a Lanes<T>,
    /// `d.x - shear d.y` and `d.y` of the first pixel.
    s: T,
    dy: T,
    /// Factors of their squares in the binary logarithm of the footprint.
    by_square: T,
    by_y: T,
}

/// A splat at a pixel.
pub(super) struct Fragment<T> {
    /// `d.x - shear d.y` and `d.y`.
    pub(super) offset: [T; 2],
    /// At most [`ALPHA_MAX`].
    pub(super) alpha: T,
    /// Alpha times transmittance: the weight of the splat's colour; 0 if the fragment is not drawn.
    pub(super) weight: T,
    /// Whether the weight depends on the footprint: the fragment is drawn and its alpha is not clamped.
    pub(super) has_gradient: bool,
    /// Transmittance behind the fragment; 0 once the pixel is saturated.
    pub(super) transmittance_behind: T,
}

impl<'a, T: Real> TileSplat<'a, T> {
    #[inline(always)]
    pub(super) fn new(splat: &'a Splat<T>, corner: [usize; 2], grid: &Grid<T>) -> TileSplat<'a, T> {
        let first = [0, 1].map(|axis| T::from_f64(corner[axis] as f64 + 0.5) - splat.center[axis]);
        let mut slant = [T::zero(); LANES];
        for (x, slant) in slant.iter_mut().enumerate() {
            *slant = grid.pixels[0][x] - splat.shear * grid.pixels[1][x];
        }
        TileSplat { splat, first, slant }
    }

    /// The blocks that the splat may reach: bit `b` is set for block `b`. Within a block, `d.x - shear d.y` and
    /// `d.y` are at least their magnitudes at its centre minus its half extents, so the Mahalanobis distance is at
    /// least the Mahalanobis distance of these differences.
    #[inline(always)]
    fn blocks(&self, grid: &Grid<T>) -> u32 {
        let splat = self.splat;
        // A little more than half the distance of the outer pixels, for rounding.
        let half_y = T::from_f64(0.5 * (BLOCK - 1) as f64 + 0.01);
        let half_s = half_y + half_y * splat.shear.abs();
        let mut blocks = 0;
        for block in 0..BLOCKS {
            let dy = self.first[1] + grid.centers[1][block];
            let s = (self.first[0] + grid.centers[0][block]) - splat.shear * dy;
            let beyond = |distance: T, half: T| {
                let beyond = distance.abs() - half;
                if beyond > T::zero() { beyond } else { T::zero() }
            };
            let (s, dy) = (beyond(s, half_s), beyond(dy, half_y));
            let q = splat.inverse_variance[0] * s * s + splat.inverse_variance[1] * dy * dy;
            blocks |= if q > splat.q_max { 0 } else { 1 << block };
        }
        blocks
    }

    #[inline(always)]
    pub(super) fn at(&self, block: usize) -> SplatBlock<'_, T> {
        let splat = self.splat;
        let [x, y] = pixel_of(block, 0).map(|at| T::from_f64(at as f64));
        let dy = self.first[1] + y;
        let half = T::from_f64(-0.5 * std::f64::consts::LOG2_E);
        SplatBlock {
            color: splat.color,
            opacity: splat.opacity,
            slant: &self.slant,
            s: (self.first[0] + x) - splat.shear * dy,
            dy,
            by_square: half * splat.inverse_variance[0],
            by_y: half * splat.inverse_variance[1],
        }
    }
}

impl<T: Real> SplatBlock<'_, T> {
    /// The fragment at pixel `x` of the block, behind others that left `transmittance`.
    #[inline(always)]
    pub(super) fn fragment(&self, grid: &Grid<T>, x: usize, transmittance: T) -> Fragment<T> {
        let (zero, most) = (T::zero(), T::from_f64(ALPHA_MAX));
        let s = self.slant[x] + self.s;
        let dy = grid.pixels[1][x] + self.dy;
        let unclamped = self.opacity * (self.by_square * s * s + self.by_y * dy * dy).exp2_of_negative();
        let alpha = if unclamped < most { unclamped } else { most };
        let behind = transmittance * (T::one() - alpha);
        let is_visible = unclamped >= T::from_f64(ALPHA_MIN);
        let is_open = behind > T::from_f64(TRANSMITTANCE_MIN);
        let is_drawn = is_visible & is_open;
        let if_visible = if is_open { behind } else { zero };
        Fragment {
            offset: [s, dy],
            alpha,
            weight: if is_drawn { alpha * transmittance } else { zero },
            has_gradient: is_drawn & (unclamped <= most),
            transmittance_behind: if is_visible { if_visible } else { transmittance },
        }
    }
}
