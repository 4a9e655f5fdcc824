//! Stage `splat`: composites sorted splats into pixels (the paper's `eq:render`).
//!
//! [`Walk`] traverses an image in bands of square tiles, in parallel. In a tile, each splat is added front
//! to back to the pixels of its ellipse; then each pixel is visited with its fragments. The result does
//! not depend on tiles or threads. [`splat`] draws by this traversal, and other modules measure by it.

use std::ops::Range;

use codec::ALPHA_MIN;
use glam::{DVec2, dvec2};
use rayon::prelude::*;

use super::evaluate::Splat;
use crate::image::Image;

/// Side of a tile in pixels.
const TILE: usize = 16;

/// Upper limit of a fragment's alpha.
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
fn composite(splats: &[Splat], fragments: &[Fragment]) -> [f64; 4] {
    let mut color = [0.0; 3];
    for fragment in fragments {
        let weight = fragment.weight();
        for (sum, c) in color.iter_mut().zip(splats[fragment.index].color) {
            *sum += c * weight;
        }
    }
    let transmittance = fragments.last().map_or(1.0, Fragment::transmittance_behind);
    [color[0], color[1], color[2], 1.0 - transmittance]
}

/// A splat's contribution to a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Index of the splat in the walk.
    pub(crate) index: usize,
    /// Opacity at the pixel, in `[ALPHA_MIN, 0.999]`.
    pub(crate) alpha: f64,
    /// Transmittance in front of the fragment.
    pub(crate) transmittance: f64,
}

impl Fragment {
    /// Blending weight `alpha T`.
    pub(crate) fn weight(&self) -> f64 {
        self.alpha * self.transmittance
    }

    /// Transmittance behind the fragment.
    fn transmittance_behind(&self) -> f64 {
        self.transmittance * (1.0 - self.alpha)
    }
}

/// A traversal of the pixels of an image with their fragments.
pub(crate) struct Walk {
    stamps: Vec<Stamp>,
    width: usize,
    height: usize,
}

impl Walk {
    /// Prepares the traversal of `splats`, which are sorted front to back.
    pub(crate) fn new(splats: &[Splat], width: u32, height: u32) -> Walk {
        let stamps = splats.par_iter().enumerate().map(|(index, splat)| Stamp::new(index, splat)).collect();
        Walk { stamps, width: width as usize, height: height as usize }
    }

    /// Visits each pixel of a band of [`TILE`] rows in a fixed order. `visit` gets the pixel's index from the
    /// band's top left corner, row by row, and its fragments, front to back.
    fn band(&self, band: usize, mut visit: impl FnMut(usize, &[Fragment])) {
        let rows = band * TILE..(band * TILE + TILE).min(self.height);
        let overlaps = |stamp: &&Stamp| stamp.overlaps_rows(&rows);
        let in_band: Vec<&Stamp> = self.stamps.iter().filter(overlaps).collect();
        let mut tile = Tile::default();
        for left in (0..self.width).step_by(TILE) {
            let columns = left..(left + TILE).min(self.width);
            tile.reset(rows.clone(), columns.clone());
            for stamp in in_band.iter().filter(|stamp| stamp.overlaps_columns(&columns)) {
                tile.add(stamp);
                if tile.open == 0 {
                    break;
                }
            }
            let places = rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y)));
            for ((x, y), pixel) in places.zip(&tile.pixels) {
                visit((y - rows.start) * self.width + x, &pixel.fragments);
            }
        }
    }

    /// Accumulates a sum per splat over all pixels. `visit` adds one pixel, given by its index in the image
    /// and its fragments front to back, to the sums of a band, one per splat. `merge` adds the sum of a
    /// band to the total. Bands are merged from top to bottom, so the result does not depend on the
    /// number of threads.
    pub(crate) fn sum_per_splat<T: Clone + Default + PartialEq + Send>(
        &self,
        visit: impl Fn(&mut [T], usize, &[Fragment]) + Sync,
        merge: impl Fn(&mut T, &T),
    ) -> Vec<T> {
        let of_band = |band: usize| {
            let mut sums = vec![T::default(); self.stamps.len()];
            let first = band * TILE * self.width;
            self.band(band, |pixel, fragments| visit(&mut sums, first + pixel, fragments));
            // Most splats do not overlap the band.
            let met = sums.into_iter().enumerate().filter(|(_, sum)| *sum != T::default());
            met.collect::<Vec<(usize, T)>>()
        };
        let bands: Vec<_> = (0..self.height.div_ceil(TILE)).into_par_iter().map(of_band).collect();
        let mut total = vec![T::default(); self.stamps.len()];
        bands.iter().flatten().for_each(|(index, sum)| merge(&mut total[*index], sum));
        total
    }
}

/// The pixels of a tile and their fragments so far.
#[derive(Default)]
struct Tile {
    rows: Range<usize>,
    columns: Range<usize>,
    /// Row by row; may be longer than the tile, left over from a larger one.
    pixels: Vec<Pixel>,
    /// Number of pixels that are not finished.
    open: usize,
}

#[derive(Clone)]
struct Pixel {
    /// Front to back.
    fragments: Vec<Fragment>,
    /// Transmittance behind all fragments; 0 once the pixel is finished.
    transmittance: f64,
}

impl Tile {
    /// Starts a new tile without fragments. Reuses the memory.
    fn reset(&mut self, rows: Range<usize>, columns: Range<usize>) {
        self.open = rows.len() * columns.len();
        (self.rows, self.columns) = (rows, columns);
        self.pixels
            .resize(self.open.max(self.pixels.len()), Pixel { fragments: Vec::new(), transmittance: 1.0 });
        for pixel in &mut self.pixels {
            pixel.fragments.clear();
            pixel.transmittance = 1.0;
        }
    }

    /// Adds a splat behind all splats so far.
    fn add(&mut self, stamp: &Stamp) {
        let width = self.columns.len();
        for y in stamp.rows(&self.rows) {
            let dy = y as f64 + 0.5 - stamp.center.y;
            let columns = stamp.columns(dy, &self.columns);
            let first = (y - self.rows.start) * width + columns.start - self.columns.start;
            let pixels = &mut self.pixels[first..first + columns.len()];
            for (x, pixel) in columns.zip(pixels) {
                if pixel.transmittance == 0.0 {
                    continue;
                }
                let alpha = stamp.alpha(x as f64 + 0.5 - stamp.center.x, dy);
                if alpha < ALPHA_MIN {
                    continue;
                }
                let fragment = Fragment { index: stamp.index, alpha, transmittance: pixel.transmittance };
                let behind = fragment.transmittance_behind();
                if behind <= TRANSMITTANCE_MIN {
                    pixel.transmittance = 0.0;
                    self.open -= 1;
                } else {
                    pixel.fragments.push(fragment);
                    pixel.transmittance = behind;
                }
            }
        }
    }
}

/// A splat prepared for the evaluation of pixels. With `d` from its centre to the pixel's, the squared
/// distance in standard deviations is `(d.y / sigma_y)^2 + ((d.x - lean d.y) / sigma_x)^2`, the marginal
/// distribution of `y` times the conditional one of `x`. A sum of squares stays accurate for needles.
struct Stamp {
    /// Index of the splat.
    index: usize,
    center: DVec2,
    /// Half the size of the bounding box outside which alpha is below [`ALPHA_MIN`].
    half_size: DVec2,
    lean: f64,
    /// `1 / sigma_x` and `1 / sigma_y`, squared.
    precision: DVec2,
    opacity: f64,
    /// Squared distance in standard deviations beyond which alpha is below [`ALPHA_MIN`].
    far: f64,
}

impl Stamp {
    fn new(index: usize, splat: &Splat) -> Stamp {
        let [xx, xy, yy] = splat.covariance;
        let radius = splat.radius();
        Stamp {
            index,
            center: splat.center,
            half_size: radius * dvec2(xx.sqrt(), yy.sqrt()),
            lean: xy / yy,
            precision: dvec2(yy / (xx * yy - xy * xy), 1.0 / yy),
            opacity: splat.opacity,
            // The margin exceeds the rounding error of the exponential.
            far: radius * radius + 1e-9,
        }
    }

    /// Whether the box overlaps `rows`.
    fn overlaps_rows(&self, rows: &Range<usize>) -> bool {
        self.center.y + self.half_size.y >= rows.start as f64
            && self.center.y - self.half_size.y <= rows.end as f64
    }

    /// Whether the box overlaps `columns`.
    fn overlaps_columns(&self, columns: &Range<usize>) -> bool {
        self.center.x + self.half_size.x >= columns.start as f64
            && self.center.x - self.half_size.x <= columns.end as f64
    }

    /// The `rows` with pixel centres in the box.
    fn rows(&self, rows: &Range<usize>) -> Range<usize> {
        pixels_between(self.center.y - self.half_size.y, self.center.y + self.half_size.y, rows)
    }

    /// A slight superset of the `columns` with alpha of [`ALPHA_MIN`] or more in the row at `dy`.
    fn columns(&self, dy: f64, columns: &Range<usize>) -> Range<usize> {
        let half = ((self.far - self.precision.y * dy * dy) / self.precision.x).max(0.0).sqrt();
        let center = self.center.x + self.lean * dy;
        pixels_between(center - half, center + half, columns)
    }

    /// `min(0.999, o exp(-q / 2))` with the squared distance `q` in standard deviations.
    fn alpha(&self, dx: f64, dy: f64) -> f64 {
        let across = dx - self.lean * dy;
        let q = self.precision.y * dy * dy + self.precision.x * across * across;
        (self.opacity * libm::exp(-0.5 * q)).min(ALPHA_MAX)
    }
}

/// The `pixels`, along one axis, with centres in `[start, end]`.
fn pixels_between(start: f64, end: f64, pixels: &Range<usize>) -> Range<usize> {
    // Casts saturate.
    let first = ((start - 0.5).ceil() as usize).clamp(pixels.start, pixels.end);
    let last = ((end + 0.5).floor() as usize).clamp(first, pixels.end);
    first..last
}
