//! Stage `rasterize_backward`: from the gradient by the pixels to that by the splats.
//!
//! A tile is drawn again, front to back. Of the pixel's colours times their gradients, what is behind a
//! fragment is what is left of the sum; nothing has to be divided by a transmittance, which can be tiny.
//! Each tile keeps a list of what it adds to its splats; then each splat adds up what tiles have for
//! it, in their order.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::bin::{TILE, Tiles};
use super::project::Splat;
use super::rasterize::{Lanes, Light, Stamp, StampRow};
use crate::fit::precision::Real;
use crate::fit::views::RenderedImage;

/// Splats that add up what tiles have for them, by one thread in one go.
const CHUNK: usize = 1024;

/// The gradient by what a splat is to the rasteriser.
#[derive(Clone, Copy, Debug)]
pub(super) struct SplatGradient<T> {
    pub(super) center: [T; 2],
    pub(super) lean: T,
    pub(super) precision: [T; 2],
    pub(super) opacity: T,
    pub(super) color: [T; 3],
}

/// The gradient by each of `splats`, given that by the pixels. `arch` says how wide vectors are, which
/// does not show.
pub(super) fn rasterize_backward<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    reached: &[u32],
    picture: &RenderedImage<T>,
    d_picture: &[[T; 4]],
) -> Vec<SplatGradient<T>> {
    let drawn = |tile: usize| &tiles.splats(tile)[..reached[tile] as usize];
    let back = |tile| {
        arch.dispatch(Back { splats, order: drawn(tile), corner: tiles.corner(tile), picture, d_picture })
    };
    let of_tiles: Vec<Vec<SplatGradient<T>>> = (0..tiles.len()).into_par_iter().map(back).collect();

    let mut sums = vec![SplatGradient::zero(); splats.len()];
    sums.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, sums)| {
        let first = chunk * CHUNK;
        for (tile, gradients) in of_tiles.iter().enumerate() {
            // The splats of a tile rise.
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
        SplatGradient { center: [z; 2], lean: z, precision: [z; 2], opacity: z, color: [z; 3] }
    }

    fn add(&mut self, other: &SplatGradient<T>) {
        (0..2).for_each(|axis| self.center[axis] += other.center[axis]);
        self.lean += other.lean;
        (0..2).for_each(|axis| self.precision[axis] += other.precision[axis]);
        self.opacity += other.opacity;
        (0..3).for_each(|channel| self.color[channel] += other.color[channel]);
    }
}

/// Goes back through one tile.
struct Back<'a, T> {
    splats: &'a [Splat<T>],
    /// Those that were drawn.
    order: &'a [u32],
    corner: [usize; 2],
    picture: &'a RenderedImage<T>,
    d_picture: &'a [[T; 4]],
}

impl<T: Real> NullaryFnOnce for Back<'_, T> {
    /// The gradient by each of the splats.
    type Output = Vec<SplatGradient<T>>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let size = [self.picture.width as usize, self.picture.height as usize];
        let mut light = Light::new(self.corner, size);
        let mut pixels = Pixels::new(self.corner, self.picture, self.d_picture);
        let mut gradients = Vec::with_capacity(self.order.len());
        // A plain loop: what iterators call is not compiled for the vectors of the machine.
        for index in self.order {
            let splat = &self.splats[*index as usize];
            let stamp = Stamp::new(splat, self.corner);
            let mut sums = Sums::new();
            for row in stamp.rows() {
                let v = T::from_f64(row as f64 + 0.5 - MIDDLE);
                sums.add(&stamp.at(row), splat, v, &mut light.transmittance[row], &mut pixels.rows[row]);
            }
            gradients.push(sums.gradient(splat, self.corner));
        }
        gradients
    }
}

/// From a tile's edge to its middle, from where moments are counted: that keeps them small.
const MIDDLE: f64 = TILE as f64 / 2.0;

/// The pixels of a tile: of each, the gradient, and the sum over the channels of what is still to come
/// times the gradient.
struct Pixels<T> {
    rows: [PixelRow<T>; TILE],
}

struct PixelRow<T> {
    gradient: [Lanes<T>; 4],
    rest: Lanes<T>,
}

impl<T: Real> Pixels<T> {
    #[inline(always)]
    fn new(corner: [usize; 2], picture: &RenderedImage<T>, d_picture: &[[T; 4]]) -> Pixels<T> {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let row = |y: usize| {
            let mut row = PixelRow { gradient: [[T::zero(); TILE]; 4], rest: [T::zero(); TILE] };
            if corner[1] + y >= height {
                return row;
            }
            for x in 0..TILE.min(width - corner[0]) {
                let index = (corner[1] + y) * width + corner[0] + x;
                let pixel = picture.pixels[index].into_iter().zip(d_picture[index]);
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

/// Sums down the columns of a tile, for one splat.
struct Sums<T> {
    /// Gradients by the exponent of the footprint, times 1, v and v^2.
    exponent: [Lanes<T>; 3],
    color: [Lanes<T>; 3],
}

impl<T: Real> Sums<T> {
    #[inline(always)]
    fn new() -> Sums<T> {
        Sums { exponent: [[T::zero(); TILE]; 3], color: [[T::zero(); TILE]; 3] }
    }

    /// Adds a row, `v` pixels below the middle of the tile.
    #[inline(always)]
    fn add(
        &mut self,
        stamp: &StampRow<T>,
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
            let fragment = stamp.fragment(x, through);
            transmittance[x] = fragment.transmittance_behind;
            let gain = color[0] * d_red[x] + color[1] * d_green[x] + color[2] * d_blue[x] + d_alpha[x];
            let rest = pixels.rest[x] - fragment.weight * gain;
            pixels.rest[x] = rest;
            let by_alpha = through * gain - rest / (T::one() - fragment.alpha);
            let by_exponent = if fragment.is_free { by_alpha * fragment.alpha } else { T::zero() };
            e[x] += by_exponent;
            ev[x] += by_exponent * v;
            evv[x] += by_exponent * v * v;
            red[x] += fragment.weight * d_red[x];
            green[x] += fragment.weight * d_green[x];
            blue[x] += fragment.weight * d_blue[x];
        }
    }

    /// The gradient by what determines alpha: `o exp(-q/2)`, `q = p0 s^2 + p1 dy^2`,
    /// `s = dx - lean dy`. In the tile `dx = dx0 + u` and `dy = dy0 + v`, so that the sums of the
    /// exponent's gradient times powers of `s` and `dy` follow from those times powers of `u` and `v`.
    #[inline(always)]
    fn gradient(&self, splat: &Splat<T>, corner: [usize; 2]) -> SplatGradient<T> {
        let [e, ev, evv] = &self.exponent;
        let u: Lanes<T> = std::array::from_fn(|x| T::from_f64(x as f64 + 0.5 - MIDDLE));
        let weighted = |lanes: &Lanes<T>| std::array::from_fn(|x| lanes[x] * u[x]);
        let eu = weighted(e);
        let (m, mu, muu) = (sum(e), sum(&eu), sum(&weighted(&eu)));
        let (mv, muv, mvv) = (sum(ev), sum(&weighted(ev)), sum(evv));

        let lean = splat.lean;
        let dy0 = T::from_f64(corner[1] as f64 + MIDDLE) - splat.center[1];
        let s0 = T::from_f64(corner[0] as f64 + MIDDLE) - splat.center[0] - lean * dy0;
        let two = T::from_f64(2.0);
        // Sums of s, dy, s^2, s dy, dy^2.
        let slant = mu - lean * mv;
        let s = s0 * m + slant;
        let y = dy0 * m + mv;
        let ss = s0 * (s + slant) + muu - lean * (two * muv - lean * mvv);
        let sy = dy0 * s + s0 * mv + muv - lean * mvv;
        let yy = dy0 * (y + mv) + mvv;

        let [p0, p1] = splat.precision;
        let half = -T::from_f64(0.5);
        SplatGradient {
            center: [p0 * s, p1 * y - lean * p0 * s],
            lean: p0 * sy,
            precision: [half * ss, half * yy],
            opacity: m / splat.opacity,
            color: [sum(&self.color[0]), sum(&self.color[1]), sum(&self.color[2])],
        }
    }
}

/// The sum over a row, in pairs: always in this order.
#[inline(always)]
fn sum<T: Real>(lanes: &Lanes<T>) -> T {
    let eight: [T; 8] = std::array::from_fn(|x| lanes[x] + lanes[x + 8]);
    let four: [T; 4] = std::array::from_fn(|x| eight[x] + eight[x + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}
