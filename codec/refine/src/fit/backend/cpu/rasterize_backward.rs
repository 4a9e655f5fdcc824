//! Stage `rasterize_backward`: backpropagates the gradient from pixels to splats.
//!
//! A tile is composited again, front to back. `rest` = sum over the fragments behind of their colour dot
//! the pixel's gradient: the total minus the running sum. Nothing is divided by a transmittance, which can
//! be tiny. Tiles compute their contributions in parallel; then each splat sums those of its tiles, in
//! the order of the tiles.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::bin::{TILE, Tiles};
use super::project::Splat;
use super::rasterize::{Lanes, SplatRow, TileSplat, Transmittance};
use crate::fit::precision::Real;
use crate::fit::views::RenderedImage;

/// Splats per parallel task of the final sums.
const CHUNK: usize = 1024;

/// The gradient with respect to a splat.
#[derive(Clone, Copy, Debug)]
pub(super) struct SplatGradient<T> {
    pub(super) center: [T; 2],
    pub(super) shear: T,
    pub(super) inverse_variance: [T; 2],
    pub(super) opacity: T,
    pub(super) color: [T; 3],
}

/// The gradients of all `splats`, given that of the pixels. The result does not depend on the vector width
/// of `arch`.
pub(super) fn rasterize_backward<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    composited: &[u32],
    image: &RenderedImage<T>,
    d_image: &[[T; 4]],
) -> Vec<SplatGradient<T>> {
    let drawn = |tile: usize| &tiles.splats(tile)[..composited[tile] as usize];
    let backward = |tile| {
        arch.dispatch(TileBackward { splats, order: drawn(tile), corner: tiles.corner(tile), image, d_image })
    };
    let by_tile: Vec<Vec<SplatGradient<T>>> = (0..tiles.len()).into_par_iter().map(backward).collect();

    let mut sums = vec![SplatGradient::zero(); splats.len()];
    sums.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, sums)| {
        let first = chunk * CHUNK;
        for (tile, gradients) in by_tile.iter().enumerate() {
            // The splats of a tile ascend.
            let order = drawn(tile);
            let start = order.partition_point(|index| (*index as usize) < first);
            for (index, gradient) in order[start..].iter().zip(&gradients[start..]) {
                let Some(sum) = sums.get_mut(*index as usize - first) else { break };
                sum.add(gradient);
            }
        }
    });
    sums
}

impl<T: Real> SplatGradient<T> {
    fn zero() -> SplatGradient<T> {
        let z = T::zero();
        SplatGradient { center: [z; 2], shear: z, inverse_variance: [z; 2], opacity: z, color: [z; 3] }
    }

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
    /// The splats composited, front to back.
    order: &'a [u32],
    corner: [usize; 2],
    image: &'a RenderedImage<T>,
    d_image: &'a [[T; 4]],
}

impl<T: Real> NullaryFnOnce for TileBackward<'_, T> {
    /// The contribution of the tile to the gradient of each splat.
    type Output = Vec<SplatGradient<T>>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let size = [self.image.width as usize, self.image.height as usize];
        let mut transmittance = Transmittance::new(self.corner, size);
        let mut pixels = Pixels::new(self.corner, self.image, self.d_image);
        let mut gradients = Vec::with_capacity(self.order.len());
        // A plain loop: the closures of iterators would not be compiled for the vector width of `arch`.
        for index in self.order {
            let splat = &self.splats[*index as usize];
            let tile_splat = TileSplat::new(splat, self.corner);
            let mut sums = Sums::new();
            for row in tile_splat.rows() {
                let v = T::from_f64(row as f64 + 0.5 - HALF_TILE);
                let through = &mut transmittance.rows[row];
                sums.add(&tile_splat.at(row), splat, v, through, &mut pixels.rows[row]);
            }
            gradients.push(sums.gradient(splat, self.corner));
        }
        gradients
    }
}

/// Offset of a tile's centre. Moments about the centre stay small.
const HALF_TILE: f64 = TILE as f64 / 2.0;

/// The gradient and the `rest` of the pixels of a tile.
struct Pixels<T> {
    rows: [PixelRow<T>; TILE],
}

struct PixelRow<T> {
    gradient: [Lanes<T>; 4],
    rest: Lanes<T>,
}

impl<T: Real> Pixels<T> {
    #[inline(always)]
    fn new(corner: [usize; 2], image: &RenderedImage<T>, d_image: &[[T; 4]]) -> Pixels<T> {
        let (width, height) = (image.width as usize, image.height as usize);
        let row = |y: usize| {
            let mut row = PixelRow { gradient: [[T::zero(); TILE]; 4], rest: [T::zero(); TILE] };
            if corner[1] + y >= height {
                return row;
            }
            for x in 0..TILE.min(width - corner[0]) {
                let index = (corner[1] + y) * width + corner[0] + x;
                let pixel = image.pixels[index].into_iter().zip(d_image[index]);
                for (channel, (color, gradient)) in pixel.enumerate() {
                    row.gradient[channel][x] = gradient;
                    row.rest[x] += color * gradient;
                }
            }
            row
        };
        Pixels { rows: std::array::from_fn(row) }
    }
}

/// Sums over the rows of a tile, per column, for one splat.
struct Sums<T> {
    /// Gradient with respect to the exponent of the footprint, times 1, v and v^2.
    exponent: [Lanes<T>; 3],
    color: [Lanes<T>; 3],
}

impl<T: Real> Sums<T> {
    #[inline(always)]
    fn new() -> Sums<T> {
        Sums { exponent: [[T::zero(); TILE]; 3], color: [[T::zero(); TILE]; 3] }
    }

    /// Adds a row, `v` pixels below the centre of the tile.
    #[inline(always)]
    fn add(
        &mut self,
        row: &SplatRow<T>,
        splat: &Splat<T>,
        v: T,
        transmittance: &mut Lanes<T>,
        pixels: &mut PixelRow<T>,
    ) {
        let [e, ev, evv] = &mut self.exponent;
        let [red, green, blue] = &mut self.color;
        let [d_red, d_green, d_blue, d_alpha] = &pixels.gradient;
        let color = splat.color;
        for x in 0..TILE {
            let through = transmittance[x];
            let fragment = row.fragment(x, through);
            transmittance[x] = fragment.transmittance_behind;
            let gain = color[0] * d_red[x] + color[1] * d_green[x] + color[2] * d_blue[x] + d_alpha[x];
            let rest = pixels.rest[x] - fragment.weight * gain;
            pixels.rest[x] = rest;
            let by_alpha = through * gain - rest / (T::one() - fragment.alpha);
            let by_exponent = if fragment.has_gradient { by_alpha * fragment.alpha } else { T::zero() };
            e[x] += by_exponent;
            ev[x] += by_exponent * v;
            evv[x] += by_exponent * v * v;
            red[x] += fragment.weight * d_red[x];
            green[x] += fragment.weight * d_green[x];
            blue[x] += fragment.weight * d_blue[x];
        }
    }

    /// The gradient with respect to the splat. Alpha is `o exp(-q/2)` with `q = p0 s^2 + p1 dy^2`,
    /// `s = dx - shear dy` and the inverse variances `p0, p1`. In the tile `dx = dx0 + u` and
    /// `dy = dy0 + v`: the moments in `s` and `dy` follow from those in `u` and `v`.
    #[inline(always)]
    fn gradient(&self, splat: &Splat<T>, corner: [usize; 2]) -> SplatGradient<T> {
        let [e, ev, evv] = &self.exponent;
        let u: Lanes<T> = std::array::from_fn(|x| T::from_f64(x as f64 + 0.5 - HALF_TILE));
        let weighted = |lanes: &Lanes<T>| std::array::from_fn(|x| lanes[x] * u[x]);
        let eu = weighted(e);
        let (m, mu, muu) = (sum(e), sum(&eu), sum(&weighted(&eu)));
        let (mv, muv, mvv) = (sum(ev), sum(&weighted(ev)), sum(evv));

        let shear = splat.shear;
        let dy0 = T::from_f64(corner[1] as f64 + HALF_TILE) - splat.center[1];
        let s0 = T::from_f64(corner[0] as f64 + HALF_TILE) - splat.center[0] - shear * dy0;
        let two = T::from_f64(2.0);
        // Moments of s, dy, s^2, s dy, dy^2.
        let slant = mu - shear * mv;
        let s = s0 * m + slant;
        let y = dy0 * m + mv;
        let ss = s0 * (s + slant) + muu - shear * (two * muv - shear * mvv);
        let sy = dy0 * s + s0 * mv + muv - shear * mvv;
        let yy = dy0 * (y + mv) + mvv;

        let [p0, p1] = splat.inverse_variance;
        let half = -T::from_f64(0.5);
        SplatGradient {
            center: [p0 * s, p1 * y - shear * p0 * s],
            shear: p0 * sy,
            inverse_variance: [half * ss, half * yy],
            opacity: m / splat.opacity,
            color: [sum(&self.color[0]), sum(&self.color[1]), sum(&self.color[2])],
        }
    }
}

/// Sum over a row, pairwise and in a fixed order.
#[inline(always)]
fn sum<T: Real>(lanes: &Lanes<T>) -> T {
    let eight: [T; 8] = std::array::from_fn(|x| lanes[x] + lanes[x + 8]);
    let four: [T; 4] = std::array::from_fn(|x| eight[x] + eight[x + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}
