//! Stage `rasterize_backward`: backpropagates the gradient from pixels to splats.
//!
//! A tile is composited again, front to back. `rest` = sum over the fragments behind of their colour dot
//! the pixel's gradient: the total minus the running sum. Nothing is divided by a transmittance, which can
//! be tiny. Tiles compute their contributions in parallel; then each splat sums the contributions of its tiles, in
//! the order of the tiles.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::fit::views::RenderedImage;
use crate::raster::{
    BLOCKS, DrawnSplat, Grid, LANES, Lanes, Real, Splat, SplatBlock, TileSplat, Tiles, Transmittance,
    pixels_of, sum_by_splat, sum_lanes,
};

/// The gradient with respect to a splat.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SplatGradient<T> {
    pub(super) center: [T; 2],
    pub(super) shear: T,
    pub(super) inverse_variance: [T; 2],
    pub(super) opacity: T,
    pub(super) color: [T; 3],
}

/// The gradients of all `splats`, given the gradient of the pixels. The result does not depend on the vector width
/// of `arch`.
pub(super) fn rasterize_backward<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    drawn: &[Vec<DrawnSplat>],
    image: &RenderedImage<T>,
    d_image: &[[T; 4]],
) -> Vec<SplatGradient<T>> {
    let backward = |tile: usize| {
        let drawn = &drawn[tile][..];
        arch.dispatch(TileBackward { splats, drawn, corner: tiles.corner(tile), image, d_image })
    };
    let by_tile: Vec<Vec<SplatGradient<T>>> = (0..tiles.len()).into_par_iter().map(backward).collect();

    sum_by_splat(splats.len(), drawn, &by_tile, SplatGradient::add)
}

impl<T: Real> SplatGradient<T> {
    fn add(&mut self, other: &SplatGradient<T>) {
        (0..2).for_each(|axis| self.center[axis] += other.center[axis]);
        self.shear += other.shear;
        (0..2).for_each(|axis| self.inverse_variance[axis] += other.inverse_variance[axis]);
        self.opacity += other.opacity;
        (0..3).for_each(|channel| self.color[channel] += other.color[channel]);
    }
}

/// Backpropagates through one tile.
struct TileBackward<'a, T> {
    splats: &'a [Splat<T>],
    /// Front to back.
    drawn: &'a [DrawnSplat],
    corner: [usize; 2],
    image: &'a RenderedImage<T>,
    d_image: &'a [[T; 4]],
}

impl<T: Real> NullaryFnOnce for TileBackward<'_, T> {
    /// The contribution of the tile to the gradient of each splat.
    type Output = Vec<SplatGradient<T>>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        if self.drawn.is_empty() {
            return Vec::new();
        }
        let size = [self.image.width as usize, self.image.height as usize];
        let mut transmittance = Transmittance::new(self.corner, size);
        let mut pixels = Pixels::new(self.corner, size, &self.image.pixels, self.d_image);
        let mut gradients = Vec::with_capacity(self.drawn.len());
        let grid = Grid::new();
        // A plain loop: the closures of iterators would not be compiled for the vector width of `arch`.
        for DrawnSplat { index, blocks } in self.drawn {
            let splat = &self.splats[*index as usize];
            let tile_splat = TileSplat::new(splat, self.corner, &grid);
            let mut sums = Sums::new();
            let mut rest = *blocks;
            while rest != 0 {
                let block = rest.trailing_zeros() as usize % BLOCKS;
                rest &= rest - 1;
                let through = &mut transmittance.blocks[block];
                let pixels = &mut pixels.blocks[block];
                sums.add(&tile_splat.at(block, &grid), splat.color, &grid, through, pixels);
            }
            gradients.push(sums.gradient(splat));
        }
        gradients
    }
}

/// The gradient and the `rest` of the pixels of a tile.
struct Pixels<T> {
    blocks: [PixelBlock<T>; BLOCKS],
}

struct PixelBlock<T> {
    gradient: [Lanes<T>; 4],
    rest: Lanes<T>,
}

impl<T: Real> Pixels<T> {
    #[inline(always)]
    fn new(corner: [usize; 2], size: [usize; 2], colors: &[[T; 4]], d_image: &[[T; 4]]) -> Pixels<T> {
        let block = |block: usize| {
            let mut pixels = PixelBlock { gradient: [[T::zero(); LANES]; 4], rest: [T::zero(); LANES] };
            for (lane, pixel) in pixels_of(block, corner, size) {
                for (channel, (color, gradient)) in colors[pixel].into_iter().zip(d_image[pixel]).enumerate()
                {
                    pixels.gradient[channel][lane] = gradient;
                    pixels.rest[lane] += color * gradient;
                }
            }
            pixels
        };
        Pixels { blocks: std::array::from_fn(block) }
    }
}

/// Number of sums per splat.
const SUMS: usize = 9;

/// Sums over the blocks of a tile, per lane, for one splat.
struct Sums<T> {
    /// Six sums of the gradient with respect to the exponent of the footprint, times 1, s, y, s^2, s y and y^2, where
    /// `s` is `d.x - shear d.y` and `y` is `d.y`. Three sums of the gradient with respect to the colour.
    lanes: [Lanes<T>; SUMS],
}

impl<T: Real> Sums<T> {
    #[inline(always)]
    fn new() -> Sums<T> {
        Sums { lanes: [[T::zero(); LANES]; SUMS] }
    }

    #[inline(always)]
    fn add(
        &mut self,
        splat: &SplatBlock<T>,
        color: [T; 3],
        grid: &Grid<T>,
        transmittance: &mut Lanes<T>,
        pixels: &mut PixelBlock<T>,
    ) {
        let [e, es, ey, ess, esy, eyy, red, green, blue] = &mut self.lanes;
        let [d_red, d_green, d_blue, d_alpha] = &pixels.gradient;
        for x in 0..LANES {
            let through = transmittance[x];
            let fragment = splat.fragment(grid, x, through);
            transmittance[x] = fragment.transmittance_behind;
            let gain = color[0] * d_red[x] + color[1] * d_green[x] + color[2] * d_blue[x] + d_alpha[x];
            let rest = pixels.rest[x] - fragment.weight * gain;
            pixels.rest[x] = rest;
            let by_alpha = through * gain - rest / (T::one() - fragment.alpha);
            let by_exponent = if fragment.has_gradient { by_alpha * fragment.alpha } else { T::zero() };
            let [s, y] = fragment.offset;
            let (by_s, by_y) = (by_exponent * s, by_exponent * y);
            e[x] += by_exponent;
            es[x] += by_s;
            ey[x] += by_y;
            ess[x] += by_s * s;
            esy[x] += by_s * y;
            eyy[x] += by_y * y;
            red[x] += fragment.weight * d_red[x];
            green[x] += fragment.weight * d_green[x];
            blue[x] += fragment.weight * d_blue[x];
        }
    }

    /// The gradient with respect to the splat. Alpha is `o exp(-q/2)` with `q = p0 s^2 + p1 y^2` and the inverse
    /// variances `p0, p1`.
    #[inline(always)]
    fn gradient(&self, splat: &Splat<T>) -> SplatGradient<T> {
        let [m, s, y, ss, sy, yy, red, green, blue] = self.totals();
        let [p0, p1] = splat.inverse_variance;
        let half = -T::from_f64(0.5);
        SplatGradient {
            center: [p0 * s, p1 * y - splat.shear * p0 * s],
            shear: p0 * sy,
            inverse_variance: [half * ss, half * yy],
            opacity: m / splat.opacity,
            color: [red, green, blue],
        }
    }

    /// Sums over the lanes. Inlined, it would make the compiler keep some sums of the loop over blocks lane by lane, which
    /// takes twice as long.
    #[inline(never)]
    fn totals(&self) -> [T; SUMS] {
        let mut totals = [T::zero(); SUMS];
        for (total, lanes) in totals.iter_mut().zip(&self.lanes) {
            *total = sum_lanes(lanes);
        }
        totals
    }
}
