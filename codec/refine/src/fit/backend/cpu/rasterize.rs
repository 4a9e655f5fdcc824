//! Stage `rasterize`: composites splats into pixels, front to back (the paper's rendering equation).
//!
//! Tiles are independent and run in parallel. Within a tile, each splat is added to the rows of pixels
//! that it reaches. The loop over a row has no branches, so the compiler vectorises it.

use codec::ALPHA_MIN;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::bin::{TILE, Tiles, pixels_between};
use super::project::Splat;
use crate::fit::precision::Real;
use crate::fit::views::RenderedImage;

/// Largest alpha of a fragment.
pub(in crate::fit) const ALPHA_MAX: f64 = 0.999;

/// A pixel is saturated before the fragment that would lower its transmittance to this.
pub(in crate::fit) const TRANSMITTANCE_MIN: f64 = 1e-4;

/// Splats between checks whether a tile is saturated.
const ROUND: usize = 8;

/// One number per pixel of a tile row.
pub(super) type Lanes<T> = [T; TILE];

/// Composites splats, which are sorted front to back. Returns the image and, per tile, the number of
/// splats composited before all its pixels were saturated. The result does not depend on the vector width
/// of `arch`.
pub(super) fn rasterize<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    width: u32,
    height: u32,
) -> (RenderedImage<T>, Vec<u32>) {
    let size = [width as usize, height as usize];
    let composite = |tile| {
        arch.dispatch(Composite { splats, order: tiles.splats(tile), corner: tiles.corner(tile), size })
    };
    let drawn: Vec<_> = (0..tiles.len()).into_par_iter().map(composite).collect();
    let mut pixels = vec![[T::zero(); 4]; size[0] * size[1]];
    let bands = pixels.par_chunks_mut(TILE * size[0]).zip(drawn.par_chunks(size[0].div_ceil(TILE)));
    bands.for_each(|(band, tiles)| {
        for (y, row) in band.chunks_mut(size[0]).enumerate() {
            for (part, (channels, _)) in row.chunks_mut(TILE).zip(tiles) {
                for (x, pixel) in part.iter_mut().enumerate() {
                    *pixel = [0, 1, 2, 3].map(|channel| channels[channel][y][x]);
                }
            }
        }
    });
    (RenderedImage { width, height, pixels }, drawn.iter().map(|(_, reached)| *reached).collect())
}

/// Composites one tile.
struct Composite<'a, T> {
    splats: &'a [Splat<T>],
    order: &'a [u32],
    corner: [usize; 2],
    size: [usize; 2],
}

impl<T: Real> NullaryFnOnce for Composite<'_, T> {
    /// Red, green, blue and alpha of the pixels, and the number of splats composited.
    type Output = (Box<[[Lanes<T>; TILE]; 4]>, u32);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let mut channels = Box::new([[[T::zero(); TILE]; TILE]; 4]);
        let [red, green, blue, alpha] = &mut *channels;
        let mut transmittance = Transmittance::new(self.corner, self.size);
        let mut composited = 0;
        for (count, index) in self.order.iter().enumerate() {
            if count % ROUND == 0 && transmittance.is_zero() {
                break;
            }
            composited += 1;
            let splat = TileSplat::new(&self.splats[*index as usize], self.corner);
            for row in splat.rows() {
                let channels = [&mut red[row], &mut green[row], &mut blue[row], &mut alpha[row]];
                add(&splat.at(row), &mut transmittance.rows[row], channels);
            }
        }
        (channels, composited)
    }
}

/// Adds a splat to a tile row.
#[inline(always)]
fn add<T: Real>(
    splat: &SplatRow<T>,
    transmittance: &mut Lanes<T>,
    [red, green, blue, alpha]: [&mut Lanes<T>; 4],
) {
    for x in 0..TILE {
        let fragment = splat.fragment(x, transmittance[x]);
        transmittance[x] = fragment.transmittance_behind;
        red[x] += fragment.weight * splat.color[0];
        green[x] += fragment.weight * splat.color[1];
        blue[x] += fragment.weight * splat.color[2];
        alpha[x] += fragment.weight;
    }
}

/// Transmittance of the pixels of a tile.
pub(super) struct Transmittance<T> {
    /// Row by row; 0 if a pixel is saturated or outside the image.
    pub(super) rows: [Lanes<T>; TILE],
}

impl<T: Real> Transmittance<T> {
    #[inline(always)]
    pub(super) fn new(corner: [usize; 2], size: [usize; 2]) -> Transmittance<T> {
        let pixel = |x: usize, y: usize| {
            if corner[0] + x < size[0] && corner[1] + y < size[1] { T::one() } else { T::zero() }
        };
        Transmittance { rows: std::array::from_fn(|y| std::array::from_fn(|x| pixel(x, y))) }
    }

    #[inline(always)]
    fn is_zero(&self) -> bool {
        let mut sums = [T::zero(); TILE];
        for row in &self.rows {
            for x in 0..TILE {
                sums[x] += row[x];
            }
        }
        sums.iter().all(|sum| *sum == T::zero())
    }
}

/// A splat relative to a tile.
pub(super) struct TileSplat<'a, T> {
    splat: &'a Splat<T>,
    /// x of the tile's pixels from the splat's centre.
    dx: Lanes<T>,
    /// y of the tile's upper edge from the splat's centre.
    top: T,
}

/// A splat relative to a tile row.
pub(super) struct SplatRow<'a, T> {
    color: [T; 3],
    opacity: T,
    dx: &'a Lanes<T>,
    /// Mean of `dx` at this y.
    mean: T,
    /// -1/2 times the inverse variance of x given y.
    by_square: T,
    /// -1/2 times the squared Mahalanobis distance of y.
    by_y: T,
}

/// A splat at a pixel.
pub(super) struct Fragment<T> {
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
    pub(super) fn new(splat: &'a Splat<T>, corner: [usize; 2]) -> TileSplat<'a, T> {
        let left = T::from_f64(corner[0] as f64 + 0.5) - splat.center[0];
        let top = T::from_f64(corner[1] as f64) - splat.center[1];
        TileSplat { splat, dx: std::array::from_fn(|x| left + T::from_f64(x as f64)), top }
    }

    /// The rows of the tile that the splat reaches.
    #[inline(always)]
    pub(super) fn rows(&self) -> std::ops::Range<usize> {
        let half = self.splat.half_extent[1];
        pixels_between(-half - self.top, half - self.top, TILE)
    }

    #[inline(always)]
    pub(super) fn at(&self, row: usize) -> SplatRow<'_, T> {
        let splat = self.splat;
        let dy = self.top + T::from_f64(row as f64 + 0.5);
        let half = -T::from_f64(0.5);
        SplatRow {
            color: splat.color,
            opacity: splat.opacity,
            dx: &self.dx,
            mean: splat.shear * dy,
            by_square: half * splat.inverse_variance[0],
            by_y: half * splat.inverse_variance[1] * dy * dy,
        }
    }
}

impl<T: Real> SplatRow<'_, T> {
    /// The fragment at pixel `x`, behind others that left `transmittance`.
    #[inline(always)]
    pub(super) fn fragment(&self, x: usize, transmittance: T) -> Fragment<T> {
        let (zero, most) = (T::zero(), T::from_f64(ALPHA_MAX));
        let s = self.dx[x] - self.mean;
        let unclamped = self.opacity * (self.by_square * s * s + self.by_y).exp();
        let alpha = if unclamped < most { unclamped } else { most };
        let behind = transmittance * (T::one() - alpha);
        let is_visible = unclamped >= T::from_f64(ALPHA_MIN);
        let is_open = behind > T::from_f64(TRANSMITTANCE_MIN);
        let is_drawn = is_visible & is_open;
        let if_visible = if is_open { behind } else { zero };
        Fragment {
            alpha,
            weight: if is_drawn { alpha * transmittance } else { zero },
            has_gradient: is_drawn & (unclamped <= most),
            transmittance_behind: if is_visible { if_visible } else { transmittance },
        }
    }
}
