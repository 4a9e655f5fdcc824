//! Stage `splat`: composites sorted splats into pixels, the paper's rendering equation.
//!
//! An image is walked in bands of square tiles, in parallel. A tile first collects the splats that
//! can reach it, so that a pixel meets only those; neither the tiles nor the threads show in the
//! result. [`Walk`] is that walk; [`splat`] draws with it, others measure with it.

use codec::ALPHA_MIN;
use glam::{DVec2, dvec2};
use rayon::prelude::*;

use super::evaluate::Splat;
use crate::image::Image;

/// Side of a tile in pixels.
const TILE: usize = 16;

/// No fragment is fully opaque.
const ALPHA_MAX: f64 = 0.999;

/// A pixel is finished before the fragment that would bring its transmittance down to this.
const TRANSMITTANCE_MIN: f64 = 1e-4;

/// Composites `splats`, which are sorted front to back, over black.
pub(crate) fn splat(splats: &[Splat], width: u32, height: u32) -> Image {
    let mut image = Image::new(width, height);
    let walk = Walk::new(splats, width, height);
    let bands = image.pixels.par_chunks_mut(TILE * width as usize).enumerate();
    bands.for_each(|(band, pixels)| {
        walk.band(band, |pixel, fragments| pixels[pixel] = composite(splats, fragments));
    });
    image
}

/// The colour and alpha of a pixel.
fn composite(splats: &[Splat], fragments: &mut Fragments) -> [f64; 4] {
    let mut color = [0.0; 3];
    for fragment in &mut *fragments {
        let weight = fragment.weight();
        for (sum, c) in color.iter_mut().zip(splats[fragment.index].color) {
            *sum += c * weight;
        }
    }
    [color[0], color[1], color[2], 1.0 - fragments.transmittance]
}

/// What a splat adds to a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Index of the splat among those that are walked over.
    pub(crate) index: usize,
    /// Opacity at the pixel, in `[ALPHA_MIN, 0.999]`.
    pub(crate) alpha: f64,
    /// Part of the light from here that passes everything in front.
    pub(crate) transmittance: f64,
}

impl Fragment {
    /// Part of the splat's colour that reaches the eye.
    pub(crate) fn weight(&self) -> f64 {
        self.alpha * self.transmittance
    }
}

/// A walk over the pixels of an image and the splats that each one meets.
pub(crate) struct Walk {
    stamps: Vec<Stamp>,
    width: usize,
    height: usize,
}

impl Walk {
    /// Prepares the walk over `splats`, which are sorted front to back.
    pub(crate) fn new(splats: &[Splat], width: u32, height: u32) -> Walk {
        let stamps = splats.par_iter().enumerate().map(|(index, splat)| Stamp::new(index, splat)).collect();
        Walk { stamps, width: width as usize, height: height as usize }
    }

    /// Visits each pixel of a band, which is [`TILE`] rows high, always in the same order: its index
    /// from the band's top left corner, row by row, and its fragments.
    fn band(&self, band: usize, mut visit: impl FnMut(usize, &mut Fragments)) {
        let (top, bottom) = (band * TILE, (band * TILE + TILE).min(self.height));
        let reach = |stamp: &&Stamp| stamp.reaches_rows(top, bottom);
        let in_band: Vec<&Stamp> = self.stamps.iter().filter(reach).collect();
        let mut in_tile = Vec::new();
        for left in (0..self.width).step_by(TILE) {
            let right = (left + TILE).min(self.width);
            in_tile.clear();
            in_tile.extend(in_band.iter().filter(|stamp| stamp.reaches_columns(left, right)));
            for y in top..bottom {
                for x in left..right {
                    let point = dvec2(x as f64 + 0.5, y as f64 + 0.5);
                    let mut fragments = Fragments { stamps: in_tile.iter(), point, transmittance: 1.0 };
                    visit((y - top) * self.width + x, &mut fragments);
                }
            }
        }
    }

    /// Sums something up per splat, over all pixels: `visit` is given the sums so far in the band,
    /// one per splat, and one pixel of it: its index in the image and its fragments. `merge` adds
    /// the sum of one band to another. Bands merge from top to bottom, so the result does not
    /// depend on the number of threads.
    pub(crate) fn sum_per_splat<T: Clone + Default + PartialEq + Send>(
        &self,
        visit: impl Fn(&mut [T], usize, &mut Fragments) + Sync,
        merge: impl Fn(&mut T, &T),
    ) -> Vec<T> {
        let of_band = |band: usize| {
            let mut sums = vec![T::default(); self.stamps.len()];
            let first = band * TILE * self.width;
            self.band(band, |pixel, fragments| visit(&mut sums, first + pixel, fragments));
            // Few splats reach a band.
            let met = sums.into_iter().enumerate().filter(|(_, sum)| *sum != T::default());
            met.collect::<Vec<(usize, T)>>()
        };
        let bands: Vec<_> = (0..self.height.div_ceil(TILE)).into_par_iter().map(of_band).collect();
        let mut total = vec![T::default(); self.stamps.len()];
        bands.iter().flatten().for_each(|(index, sum)| merge(&mut total[*index], sum));
        total
    }
}

/// The fragments of one pixel, front to back.
pub(crate) struct Fragments<'a> {
    stamps: std::slice::Iter<'a, &'a Stamp>,
    point: DVec2,
    /// Part of the light from behind that passes all fragments so far.
    transmittance: f64,
}

impl Iterator for Fragments<'_> {
    type Item = Fragment;

    fn next(&mut self) -> Option<Fragment> {
        for stamp in &mut self.stamps {
            let alpha = stamp.alpha(self.point);
            if alpha < ALPHA_MIN {
                continue;
            }
            let transmittance = self.transmittance;
            let next = transmittance * (1.0 - alpha);
            if next <= TRANSMITTANCE_MIN {
                self.stamps = [].iter();
                return None;
            }
            self.transmittance = next;
            return Some(Fragment { index: stamp.index, alpha, transmittance });
        }
        None
    }
}

/// A splat in the form that pixels need.
struct Stamp {
    /// Index of the splat.
    index: usize,
    center: DVec2,
    /// Half the size of the box outside which alpha is below [`ALPHA_MIN`].
    reach: DVec2,
    /// Inverse of the covariance: xx, xy, yy.
    conic: [f64; 3],
    opacity: f64,
    /// Squared distance in standard deviations from which alpha is certainly below [`ALPHA_MIN`].
    far: f64,
}

impl Stamp {
    fn new(index: usize, splat: &Splat) -> Stamp {
        let [xx, xy, yy] = splat.covariance;
        let determinant = xx * yy - xy * xy;
        let radius = splat.radius();
        Stamp {
            index,
            center: splat.center,
            reach: radius * dvec2(xx.sqrt(), yy.sqrt()),
            conic: [yy / determinant, -xy / determinant, xx / determinant],
            opacity: splat.opacity,
            // The margin is far above the rounding of the exponential.
            far: radius * radius + 1e-9,
        }
    }

    /// Whether pixels of the rows `top..bottom` can lie in the box.
    fn reaches_rows(&self, top: usize, bottom: usize) -> bool {
        self.center.y + self.reach.y >= top as f64 && self.center.y - self.reach.y <= bottom as f64
    }

    /// Whether pixels of the columns `left..right` can lie in the box.
    fn reaches_columns(&self, left: usize, right: usize) -> bool {
        self.center.x + self.reach.x >= left as f64 && self.center.x - self.reach.x <= right as f64
    }

    /// `min(0.999, o exp(-q / 2))`, `q` being the squared distance in standard deviations; 0
    /// where that is certainly below [`ALPHA_MIN`].
    fn alpha(&self, point: DVec2) -> f64 {
        let d = point - self.center;
        let [xx, xy, yy] = self.conic;
        let q = xx * d.x * d.x + 2.0 * xy * d.x * d.y + yy * d.y * d.y;
        if q > self.far {
            return 0.0;
        }
        // Far from a needle, rounding can bring q below 0.
        (self.opacity * libm::exp(-0.5 * q.max(0.0))).min(ALPHA_MAX)
    }
}
