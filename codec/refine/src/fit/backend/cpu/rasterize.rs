//! Stage `rasterize`: composites splats into pixels, the paper's rendering equation.
//!
//! Tiles are drawn in parallel. In a tile each splat, front to back, is added to the rows of pixels
//! that it reaches, a row at a time: the loop over its pixels has no branches, and so becomes vectors.

use codec::ALPHA_MIN;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::bin::{TILE, Tiles, pixels_between};
use super::project::Splat;
use crate::fit::precision::Real;
use crate::fit::views::RenderedImage;

/// No fragment is fully opaque.
pub(in crate::fit) const ALPHA_MAX: f64 = 0.999;

/// A pixel is finished before the fragment that would bring its transmittance down to this.
pub(in crate::fit) const TRANSMITTANCE_MIN: f64 = 1e-4;

/// Splats between two looks at which rows of a tile are finished.
const ROUND: usize = 8;

/// A number for each pixel in a row of a tile.
pub(super) type Lanes<T> = [T; TILE];

/// Draws splats, which are sorted front to back. Returns the picture and, of each tile, how many of its
/// splats were drawn until all its pixels were finished. `arch` says how wide vectors are, which does
/// not show.
pub(super) fn rasterize<T: Real>(
    arch: Arch,
    splats: &[Splat<T>],
    tiles: &Tiles,
    width: u32,
    height: u32,
) -> (RenderedImage<T>, Vec<u32>) {
    let size = [width as usize, height as usize];
    let draw =
        |tile| arch.dispatch(Draw { splats, order: tiles.splats(tile), corner: tiles.corner(tile), size });
    let drawn: Vec<_> = (0..tiles.len()).into_par_iter().map(draw).collect();
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

/// Draws one tile.
struct Draw<'a, T> {
    splats: &'a [Splat<T>],
    order: &'a [u32],
    corner: [usize; 2],
    size: [usize; 2],
}

impl<T: Real> NullaryFnOnce for Draw<'_, T> {
    /// Red, green, blue and alpha of its pixels, and how many of its splats were drawn.
    type Output = (Box<[[Lanes<T>; TILE]; 4]>, u32);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let mut channels = Box::new([[[T::zero(); TILE]; TILE]; 4]);
        let [red, green, blue, alpha] = &mut *channels;
        let mut light = Light::new(self.corner, self.size);
        let mut reached = 0;
        for (count, index) in self.order.iter().enumerate() {
            if count % ROUND == 0 && light.is_finished() {
                break;
            }
            reached += 1;
            let stamp = Stamp::new(&self.splats[*index as usize], self.corner);
            for row in stamp.rows() {
                let places = (&mut light.transmittance[row], &mut red[row], &mut green[row]);
                add(&stamp.at(row), places.0, places.1, places.2, &mut blue[row], &mut alpha[row]);
            }
        }
        (channels, reached)
    }
}

/// Adds a splat to a row.
#[inline(always)]
fn add<T: Real>(
    stamp: &StampRow<T>,
    transmittance: &mut Lanes<T>,
    red: &mut Lanes<T>,
    green: &mut Lanes<T>,
    blue: &mut Lanes<T>,
    alpha: &mut Lanes<T>,
) {
    for x in 0..TILE {
        let fragment = stamp.fragment(x, transmittance[x]);
        transmittance[x] = fragment.transmittance_behind;
        red[x] += fragment.weight * stamp.color[0];
        green[x] += fragment.weight * stamp.color[1];
        blue[x] += fragment.weight * stamp.color[2];
        alpha[x] += fragment.weight;
    }
}

/// The light from behind that passes what was drawn of a tile.
pub(super) struct Light<T> {
    /// Row by row; 0 where a pixel is finished, or outside the image.
    pub(super) transmittance: [Lanes<T>; TILE],
}

impl<T: Real> Light<T> {
    #[inline(always)]
    pub(super) fn new(corner: [usize; 2], size: [usize; 2]) -> Light<T> {
        let pixel = |x: usize, y: usize| {
            if corner[0] + x < size[0] && corner[1] + y < size[1] { T::one() } else { T::zero() }
        };
        Light { transmittance: std::array::from_fn(|y| std::array::from_fn(|x| pixel(x, y))) }
    }

    #[inline(always)]
    fn is_finished(&self) -> bool {
        let mut sums = [T::zero(); TILE];
        for row in &self.transmittance {
            for x in 0..TILE {
                sums[x] += row[x];
            }
        }
        sums.iter().all(|sum| *sum == T::zero())
    }
}

/// A splat as a tile sees it.
pub(super) struct Stamp<'a, T> {
    splat: &'a Splat<T>,
    /// x of the pixels of the tile, from the splat's centre.
    dx: Lanes<T>,
    /// y of the tile's upper edge, from the splat's centre.
    top: T,
}

/// A splat as a row of a tile sees it.
pub(super) struct StampRow<'a, T> {
    color: [T; 3],
    opacity: T,
    dx: &'a Lanes<T>,
    /// `dx` in the middle of the ellipse.
    middle: T,
    /// -1/2 of the precision in x.
    slope: T,
    /// -1/2 of the squared distance in standard deviations that is due to y.
    along: T,
}

/// A splat at a pixel.
pub(super) struct Fragment<T> {
    /// Opacity, at most [`ALPHA_MAX`].
    pub(super) alpha: T,
    /// Part of the splat's colour that reaches the eye; 0 where the splat is not drawn.
    pub(super) weight: T,
    /// Whether the weight follows the footprint: the splat is drawn and alpha is below its bound.
    pub(super) is_free: bool,
    /// Part of the light from behind that passes this and everything in front.
    pub(super) transmittance_behind: T,
}

impl<'a, T: Real> Stamp<'a, T> {
    #[inline(always)]
    pub(super) fn new(splat: &'a Splat<T>, corner: [usize; 2]) -> Stamp<'a, T> {
        let left = T::from_f64(corner[0] as f64 + 0.5) - splat.center[0];
        let top = T::from_f64(corner[1] as f64) - splat.center[1];
        Stamp { splat, dx: std::array::from_fn(|x| left + T::from_f64(x as f64)), top }
    }

    /// The rows of the tile that the splat can reach.
    #[inline(always)]
    pub(super) fn rows(&self) -> std::ops::Range<usize> {
        let reach = self.splat.reach[1];
        pixels_between(-reach - self.top, reach - self.top, TILE)
    }

    #[inline(always)]
    pub(super) fn at(&self, row: usize) -> StampRow<'_, T> {
        let splat = self.splat;
        let dy = self.top + T::from_f64(row as f64 + 0.5);
        let half = -T::from_f64(0.5);
        StampRow {
            color: splat.color,
            opacity: splat.opacity,
            dx: &self.dx,
            middle: splat.lean * dy,
            slope: half * splat.precision[0],
            along: half * splat.precision[1] * dy * dy,
        }
    }
}

impl<T: Real> StampRow<'_, T> {
    /// The splat at a pixel that light of the given transmittance has come to.
    #[inline(always)]
    pub(super) fn fragment(&self, x: usize, transmittance: T) -> Fragment<T> {
        let (zero, most) = (T::zero(), T::from_f64(ALPHA_MAX));
        let s = self.dx[x] - self.middle;
        let full = self.opacity * (self.slope * s * s + self.along).exp();
        let alpha = if full < most { full } else { most };
        let behind = transmittance * (T::one() - alpha);
        let is_visible = full >= T::from_f64(ALPHA_MIN);
        let is_open = behind > T::from_f64(TRANSMITTANCE_MIN);
        let is_drawn = is_visible & is_open;
        let if_visible = if is_open { behind } else { zero };
        Fragment {
            alpha,
            weight: if is_drawn { alpha * transmittance } else { zero },
            is_free: is_drawn & (full <= most),
            transmittance_behind: if is_visible { if_visible } else { transmittance },
        }
    }
}
