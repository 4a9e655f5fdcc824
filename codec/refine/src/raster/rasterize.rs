//! Stage `rasterize`: composites splats into pixels, front to back (the paper's rendering equation).
//!
//! Tiles are independent and run in parallel. Within a tile, each splat is added to the blocks of 4x4 pixels
//! that it reaches and that are not saturated. Splats that follow one another with the same footprint, of which fields
//! can have thousands, are added together. A [`Sink`] gets these blocks: [`rasterize`] draws, other modules
//! measure. A loop over a block has no branches, so the compiler vectorises it.

use codec::ALPHA_MIN;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::bin::{TILE, Tiles};
use super::project::Splat;
use super::real::Real;

/// Largest alpha of a fragment.
pub(crate) const ALPHA_MAX: f64 = 0.999;

/// A pixel is saturated before the fragment that would lower its transmittance to this.
pub(crate) const TRANSMITTANCE_MIN: f64 = 1e-4;

/// Splats per parallel task of the sums over tiles.
const CHUNK: usize = 1024;

/// Splats between checks which blocks are saturated.
const ROUND: usize = 32;

/// Side of a block in pixels.
const BLOCK: usize = 4;

/// Pixels in a block: as many lanes as the widest vectors have. In blocks of 16x1 pixels, two thirds of the lanes
/// would be outside a splat of a typical size.
pub(crate) const LANES: usize = BLOCK * BLOCK;

/// Blocks in a tile.
pub(crate) const BLOCKS: usize = (TILE / BLOCK) * (TILE / BLOCK);

/// One number per pixel of a block, row by row.
pub(crate) type Lanes<T> = [T; LANES];

/// A splat that was drawn in a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DrawnSplat {
    /// Index of the splat.
    pub(crate) index: u32,
    /// Bit `b` is set if the splat was drawn in block `b` of the tile.
    pub(crate) blocks: u32,
}

/// Column and row in a tile of the pixel at `lane` of `block`.
#[inline(always)]
fn pixel_of(block: usize, lane: usize) -> [usize; 2] {
    let across = TILE / BLOCK;
    [block % across * BLOCK + lane % BLOCK, block / across * BLOCK + lane / BLOCK]
}

/// Splats of one footprint in a block of a tile.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    /// Indices of the splats, front to back.
    pub(crate) run: &'a [u32],
    /// Index of the first of them among the splats drawn in the tile; the others follow.
    pub(crate) slot: usize,
    pub(crate) block: usize,
}

impl Place<'_> {
    #[inline(always)]
    pub(crate) fn slots(&self) -> std::ops::Range<usize> {
        self.slot..self.slot + self.run.len()
    }
}

/// What gets the splats of a tile, front to back.
pub(crate) trait Sink<T> {
    type Output: Default + Send;

    /// Draws the splats of a place, and lowers the transmittance of its pixels.
    fn add(&mut self, place: Place, splat: &SplatBlock<T>, grid: &Grid<T>, transmittance: &mut Lanes<T>);

    /// Ends the tile.
    fn finish(self) -> Self::Output;
}

/// Gives the splats of each tile, which are sorted front to back, to the sink of the tile. Returns, per tile, the result of
/// its sink, and the splats that were drawn before their pixels were saturated. The result does not depend on the vector
/// width of `arch`.
pub(crate) fn draw_tiles<T: Real, S: Sink<T>>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    sink: impl Fn(usize) -> S + Sync,
) -> Vec<(S::Output, Vec<DrawnSplat>)> {
    let draw = |tile| match tiles.splats(tile) {
        [] => Default::default(),
        order => {
            let (corner, size) = (tiles.corner(tile), tiles.size);
            arch.dispatch(DrawTile { splats, order, corner, size, sink: sink(tile) })
        }
    };
    (0..tiles.len()).into_par_iter().map(draw).collect()
}

/// Composites splats, which are sorted front to back. Returns the pixels, row by row: red, green, blue and alpha, and per
/// tile the splats that were drawn. The result does not depend on the vector width of `arch`.
pub(crate) fn rasterize<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
) -> (Vec<[T; 4]>, Vec<Vec<DrawnSplat>>) {
    let blank = |_| TileColors { splats, blocks: vec![[[T::zero(); LANES]; 4]; BLOCKS] };
    let (colors, drawn): (Vec<Vec<_>>, _) = draw_tiles(arch, splats, tiles, blank).into_iter().unzip();
    let [width, height] = tiles.size;
    let mut pixels = vec![[T::zero(); 4]; width * height];
    let bands = pixels.par_chunks_mut(TILE * width).zip(colors.par_chunks(tiles.across));
    bands.for_each(|(band, tiles)| {
        for (column, blocks) in tiles.iter().enumerate() {
            for (block, channels) in blocks.iter().enumerate() {
                for (lane, pixel) in pixels_of(block, [column * TILE, 0], [width, band.len() / width]) {
                    band[pixel] = [0, 1, 2, 3].map(|channel| channels[channel][lane]);
                }
            }
        }
    });
    (pixels, drawn)
}

/// The lanes of a block, of a tile with this `corner`, that are pixels of an image of this `size`, and the indices of the
/// pixels.
pub(crate) fn pixels_of(
    block: usize,
    corner: [usize; 2],
    size: [usize; 2],
) -> impl Iterator<Item = (usize, usize)> {
    let pixel = move |lane| {
        let [x, y] = pixel_of(block, lane);
        let [x, y] = [corner[0] + x, corner[1] + y];
        (x < size[0] && y < size[1]).then_some((lane, y * size[0] + x))
    };
    (0..LANES).filter_map(pixel)
}

/// The sum of the numbers of a block, pairwise and in a fixed order.
#[inline(always)]
pub(crate) fn sum_lanes<T: Real>(lanes: &Lanes<T>) -> T {
    let mut eight = [T::zero(); 8];
    for x in 0..8 {
        eight[x] = lanes[x] + lanes[x + 8];
    }
    let mut four = [T::zero(); 4];
    for x in 0..4 {
        four[x] = eight[x] + eight[x + 4];
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// The sums of splats, `count` in all, over the tiles, in the order of the tiles. `by_tile` has a summand for each splat
/// `drawn` in a tile.
pub(crate) fn sum_by_splat<S: Clone + Default + Send + Sync>(
    count: usize,
    drawn: &[Vec<DrawnSplat>],
    by_tile: &[Vec<S>],
    add: impl Fn(&mut S, &S) + Sync,
) -> Vec<S> {
    let mut sums = vec![S::default(); count];
    sums.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, sums)| {
        let first = chunk * CHUNK;
        for (drawn, summands) in drawn.iter().zip(by_tile) {
            // The splats of a tile ascend.
            let start = drawn.partition_point(|splat| (splat.index as usize) < first);
            for (splat, summand) in drawn[start..].iter().zip(&summands[start..]) {
                let Some(sum) = sums.get_mut(splat.index as usize - first) else { break };
                add(sum, summand);
            }
        }
    });
    sums
}

/// Draws one tile.
struct DrawTile<'a, T, S> {
    splats: &'a [Splat<T>],
    order: &'a [u32],
    corner: [usize; 2],
    size: [usize; 2],
    sink: S,
}

impl<T: Real, S: Sink<T>> NullaryFnOnce for DrawTile<'_, T, S> {
    type Output = (S::Output, Vec<DrawnSplat>);

    #[inline(always)]
    fn call(mut self) -> Self::Output {
        let mut transmittance = Transmittance::new(self.corner, self.size);
        let mut drawn = Vec::with_capacity(self.order.len());
        let grid = Grid::new();
        let splat_at = |index: &u32| &self.splats[*index as usize];
        for round in self.order.chunks(ROUND) {
            let open = transmittance.open();
            if open == 0 {
                break;
            }
            // What neighbours of one footprint have in common is computed once.
            for run in round.chunk_by(|a, b| splat_at(a).has_footprint_of(splat_at(b))) {
                let tile_splat = TileSplat::new(splat_at(&run[0]), self.corner, &grid);
                let blocks = tile_splat.blocks(&grid) & open;
                if blocks == 0 {
                    continue;
                }
                let slot = drawn.len();
                drawn.extend(run.iter().map(|index| DrawnSplat { index: *index, blocks }));
                let mut rest = blocks;
                while rest != 0 {
                    let block = rest.trailing_zeros() as usize % BLOCKS;
                    rest &= rest - 1;
                    let splat = tile_splat.at(block, &grid);
                    let place = Place { run, slot, block };
                    self.sink.add(place, &splat, &grid, &mut transmittance.blocks[block]);
                }
            }
        }
        (self.sink.finish(), drawn)
    }
}

/// Composites a tile.
struct TileColors<'a, T> {
    /// Of all tiles.
    splats: &'a [Splat<T>],
    /// Red, green, blue and alpha of each block.
    blocks: Vec<[Lanes<T>; 4]>,
}

impl<T: Real> Sink<T> for TileColors<'_, T> {
    /// The colours of the blocks, none if there are no splats.
    type Output = Vec<[Lanes<T>; 4]>;

    #[inline(always)]
    fn add(&mut self, place: Place, splat: &SplatBlock<T>, grid: &Grid<T>, transmittance: &mut Lanes<T>) {
        let [mut red, mut green, mut blue, mut alpha] = self.blocks[place.block];
        let mut through = *transmittance;
        for index in place.run {
            let color = self.splats[*index as usize].color;
            for x in 0..LANES {
                let fragment = splat.fragment(grid, x, through[x]);
                through[x] = fragment.transmittance_behind;
                red[x] += fragment.weight * color[0];
                green[x] += fragment.weight * color[1];
                blue[x] += fragment.weight * color[2];
                alpha[x] += fragment.weight;
            }
        }
        self.blocks[place.block] = [red, green, blue, alpha];
        *transmittance = through;
    }

    #[inline(always)]
    fn finish(self) -> Self::Output {
        self.blocks
    }
}

/// Transmittance of the pixels of a tile.
pub(crate) struct Transmittance<T> {
    /// Block by block; 0 if a pixel is saturated or outside the image.
    pub(crate) blocks: [Lanes<T>; BLOCKS],
}

impl<T: Real> Transmittance<T> {
    #[inline(always)]
    pub(crate) fn new(corner: [usize; 2], size: [usize; 2]) -> Transmittance<T> {
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
pub(crate) struct Grid<T> {
    /// Column and row of each pixel of a block.
    pixels: [Lanes<T>; 2],
    /// Column and row of the centre of each block, from the centre of the tile's first pixel.
    centers: [[T; BLOCKS]; 2],
}

impl<T: Real> Grid<T> {
    #[inline(always)]
    pub(crate) fn new() -> Grid<T> {
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
pub(crate) struct TileSplat<'a, T> {
    splat: &'a Splat<T>,
    /// The centre of the tile's first pixel, from the splat's centre.
    first: [T; 2],
    /// `d.x - shear d.y` of a block's pixels, minus its value at the first pixel.
    slant: Lanes<T>,
}

/// A splat relative to a block.
pub(crate) struct SplatBlock<'a, T> {
    /// Alpha at each pixel, before it is limited.
    alphas: Lanes<T>,
    slant: &'a Lanes<T>,
    /// `d.x - shear d.y` and `d.y` of the first pixel.
    s: T,
    dy: T,
    /// Factors of their squares in the exponent of [`Real::falloff`].
    by_square: T,
    by_y: T,
}

/// A splat at a pixel.
pub(crate) struct Fragment<T> {
    /// `d.x - shear d.y` and `d.y`.
    pub(crate) offset: [T; 2],
    /// At most [`ALPHA_MAX`].
    pub(crate) alpha: T,
    /// Alpha times transmittance: the weight of the splat's colour; 0 if the fragment is not drawn.
    pub(crate) weight: T,
    /// Whether the weight depends on the footprint: the fragment is drawn and its alpha is not clamped.
    pub(crate) has_gradient: bool,
    /// Transmittance behind the fragment; 0 once the pixel is saturated.
    pub(crate) transmittance_behind: T,
}

impl<'a, T: Real> TileSplat<'a, T> {
    #[inline(always)]
    pub(crate) fn new(splat: &'a Splat<T>, corner: [usize; 2], grid: &Grid<T>) -> TileSplat<'a, T> {
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
    pub(crate) fn at(&self, block: usize, grid: &Grid<T>) -> SplatBlock<'_, T> {
        let splat = self.splat;
        let [x, y] = pixel_of(block, 0).map(|at| T::from_f64(at as f64));
        let dy = self.first[1] + y;
        let half = T::from_f64(-0.5 * T::FALLOFF_SCALE);
        let mut block = SplatBlock {
            alphas: [T::zero(); LANES],
            slant: &self.slant,
            s: (self.first[0] + x) - splat.shear * dy,
            dy,
            by_square: half * splat.inverse_variance[0],
            by_y: half * splat.inverse_variance[1],
        };
        for x in 0..LANES {
            let [s, dy] = block.offset(grid, x);
            block.alphas[x] = splat.opacity * (block.by_square * s * s + block.by_y * dy * dy).falloff();
        }
        block
    }
}

impl<T: Real> SplatBlock<'_, T> {
    /// Squared Mahalanobis distance at an [offset](Fragment::offset) from the centre.
    #[inline(always)]
    pub(crate) fn distance_squared(&self, [s, y]: [T; 2]) -> T {
        (self.by_square * s * s + self.by_y * y * y) * T::from_f64(-2.0 / T::FALLOFF_SCALE)
    }

    /// The [offset](Fragment::offset) of pixel `x`.
    #[inline(always)]
    fn offset(&self, grid: &Grid<T>, x: usize) -> [T; 2] {
        [self.slant[x] + self.s, grid.pixels[1][x] + self.dy]
    }

    /// The fragment at pixel `x` of the block, behind others that left `transmittance`.
    #[inline(always)]
    pub(crate) fn fragment(&self, grid: &Grid<T>, x: usize, transmittance: T) -> Fragment<T> {
        let (zero, most) = (T::zero(), T::from_f64(ALPHA_MAX));
        let unclamped = self.alphas[x];
        let alpha = if unclamped < most { unclamped } else { most };
        let behind = transmittance * (T::one() - alpha);
        let is_visible = unclamped >= T::from_f64(ALPHA_MIN);
        let is_open = behind > T::from_f64(TRANSMITTANCE_MIN);
        let is_drawn = is_visible & is_open;
        let if_visible = if is_open { behind } else { zero };
        Fragment {
            offset: self.offset(grid, x),
            alpha,
            weight: if is_drawn { alpha * transmittance } else { zero },
            has_gradient: is_drawn & (unclamped <= most),
            transmittance_behind: if is_visible { if_visible } else { transmittance },
        }
    }
}
