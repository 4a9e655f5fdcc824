//! Stage `splat`: composites sorted splats into pixels (the paper's `eq:render`).
//!
//! [`Walk`] traverses an image in bands of square tiles, in parallel. In a tile, each splat is added front
//! to back to the pixels of its ellipse, four at once where the machine has vectors as wide, and a [`Sink`]
//! gets what it adds. The result does not depend on tiles, threads or vectors. [`splat`] draws by this traversal, and
//! other modules measure by it.

use std::ops::Range;

use codec::ALPHA_MIN;
use glam::{DVec2, dvec2};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::evaluate::Splat;
use super::exp::{LANES, Lanes, exp, pick};
use crate::image::Image;

/// Side of a tile in pixels.
pub(super) const TILE: usize = 16;

/// Numbers of a tile, one per pixel, row by row; the lanes of the last pixel reach beyond it.
pub(super) type Plane = [f64; TILE * TILE + LANES];

/// Splats between checks whether all pixels of a tile are finished.
const ROUND: usize = 32;

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
        let planes = [[0.0; TILE * TILE + LANES]; 3];
        walk.band(band, Colors { splats, planes, pixels, width: width as usize });
    });
    image
}

/// Draws a band.
struct Colors<'a> {
    splats: &'a [Splat],
    /// Red, green and blue of the tile.
    planes: [Plane; 3],
    /// Those of the band, row by row.
    pixels: &'a mut [[f64; 4]],
    width: usize,
}

impl Sink for Colors<'_> {
    #[inline(always)]
    fn add(&mut self, at: Place, fragments: &FragmentLanes) {
        let weights = fragments.weights();
        for (plane, color) in self.planes.iter_mut().zip(self.splats[at.index].color) {
            let sums = lanes_at(plane, at.pixel);
            for lane in 0..LANES {
                sums[lane] += color * weights[lane];
            }
        }
    }

    #[inline(always)]
    fn finish(&mut self, tile: &Tile) {
        for (place, pixel) in tile.pixels(self.width) {
            let [r, g, b] = [0, 1, 2].map(|channel| self.planes[channel][place]);
            self.pixels[pixel] = [r, g, b, 1.0 - tile.transmittance[place].abs()];
        }
        self.planes = [[0.0; TILE * TILE + LANES]; 3];
    }
}

/// A splat's contribution to a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    index: u32,
    slot: u32,
    /// Opacity at the pixel, in `[ALPHA_MIN, 0.999]`.
    pub(crate) alpha: f64,
    /// Transmittance in front of the fragment; 1 for the first fragment of a pixel, and for no other.
    pub(crate) transmittance: f64,
}

impl Fragment {
    /// Index of the splat in the walk.
    pub(crate) fn index(&self) -> usize {
        self.index as usize
    }

    /// Index of the splat's sum in the band.
    pub(crate) fn slot(&self) -> usize {
        self.slot as usize
    }

    /// Blending weight `alpha T`.
    pub(crate) fn weight(&self) -> f64 {
        self.alpha * self.transmittance
    }
}

/// Receives the fragments of a band, tile by tile.
pub(super) trait Sink {
    /// Adds fragments of one splat.
    fn add(&mut self, at: Place, fragments: &FragmentLanes);

    /// Ends a tile.
    fn finish(&mut self, tile: &Tile);
}

/// What several fragments are of.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// See [`Fragment::index`].
    pub(super) index: usize,
    /// See [`Fragment::slot`].
    pub(super) slot: usize,
    /// The place in the tile of the first lane's pixel; the others follow in its row.
    pub(super) pixel: usize,
}

/// Fragments in neighbouring pixels of a row.
pub(super) struct FragmentLanes {
    /// Whether there is one.
    is_drawn: [bool; LANES],
    alpha: Lanes,
    transmittance: Lanes,
    distance_squared: Lanes,
}

impl FragmentLanes {
    /// Alphas; 0 where there is no fragment.
    #[inline(always)]
    pub(super) fn alphas(&self) -> Lanes {
        self.where_drawn(|lane| self.alpha[lane])
    }

    /// Blending weights; 0 where there is no fragment.
    #[inline(always)]
    pub(super) fn weights(&self) -> Lanes {
        self.where_drawn(|lane| self.alpha[lane] * self.transmittance[lane])
    }

    /// Squared distances from the splat's centre in standard deviations; 0 where there is no fragment.
    #[inline(always)]
    pub(super) fn distances_squared(&self) -> Lanes {
        self.where_drawn(|lane| self.distance_squared[lane])
    }

    /// A number of each lane with a fragment, 0 of the others.
    #[inline(always)]
    fn where_drawn(&self, number: impl Fn(usize) -> f64) -> Lanes {
        let mut numbers = [0.0; LANES];
        for (lane, drawn) in numbers.iter_mut().enumerate() {
            *drawn = pick(self.is_drawn[lane], number(lane), 0.0);
        }
        numbers
    }

    /// Each fragment with the place of its pixel.
    #[inline(always)]
    fn each(&self, Place { index, slot, pixel }: Place, mut visit: impl FnMut(usize, Fragment)) {
        for lane in 0..LANES {
            if self.is_drawn[lane] {
                let (alpha, transmittance) = (self.alpha[lane], self.transmittance[lane]);
                let (index, slot) = (index as u32, slot as u32);
                visit(pixel + lane, Fragment { index, slot, alpha, transmittance });
            }
        }
    }
}

/// A traversal of the pixels of an image with their fragments.
pub(crate) struct Walk {
    stamps: Vec<Stamp>,
    /// Indices of the stamps that may overlap each band of [`TILE`] rows, front to back.
    bands: Vec<Vec<u32>>,
    width: usize,
    height: usize,
}

impl Walk {
    /// Prepares the traversal of `splats`, which are sorted front to back.
    pub(crate) fn new(splats: &[Splat], width: u32, height: u32) -> Walk {
        let stamps: Vec<Stamp> =
            splats.par_iter().enumerate().map(|(index, splat)| Stamp::new(index, splat)).collect();
        let (width, height) = (width as usize, height as usize);
        let mut bands = vec![Vec::new(); height.div_ceil(TILE)];
        for (index, stamp) in stamps.iter().enumerate() {
            for band in &mut bands[tiles_between(stamp.center.y, stamp.half_size.y, height)] {
                band.push(index as u32);
            }
        }
        Walk { stamps, bands, width, height }
    }

    /// Gives the fragments of a band to a sink, and returns it.
    pub(super) fn band<S: Sink>(&self, band: usize, sink: S) -> S {
        Arch::new().dispatch(Band { walk: self, band, sink })
    }

    /// Accumulates a sum per splat over all pixels. `visit` adds one pixel, given by its index in the image
    /// and its fragments front to back, to the sums of a band, at the fragments' slots. `merge` adds the sum of a
    /// band to the total. Bands are merged from top to bottom, so the result does not depend on the
    /// number of threads.
    pub(crate) fn sum_per_splat<T: Clone + Default + PartialEq + Send>(
        &self,
        visit: impl Fn(&mut [T], usize, &[Fragment]) + Sync,
        merge: impl Fn(&mut T, &T),
    ) -> Vec<T> {
        self.sum_bands(merge, |band, sums| {
            let first = band * TILE * self.width;
            let visit = |pixel: usize, fragments: &[Fragment]| visit(sums, first + pixel, fragments);
            self.band(band, Lists { pixels: vec![Vec::new(); TILE * TILE], width: self.width, visit });
        })
    }

    /// Accumulates a sum per splat over all fragments, as [`sum_per_splat`](Self::sum_per_splat) does; `add` adds one.
    pub(crate) fn sum_of_fragments<T: Clone + Default + PartialEq + Send>(
        &self,
        add: impl Fn(&mut T, &Fragment) + Sync,
        merge: impl Fn(&mut T, &T),
    ) -> Vec<T> {
        self.sum_bands(merge, |band, sums| {
            self.band(band, Sums { sums, add: &add });
        })
    }

    /// Adds the sums of all bands, from top to bottom; `of_band` computes the sums of one band.
    pub(super) fn sum_bands<T: Clone + Default + PartialEq + Send>(
        &self,
        merge: impl Fn(&mut T, &T),
        of_band: impl Fn(usize, &mut [T]) + Sync,
    ) -> Vec<T> {
        let of_band = |band: usize| {
            let mut sums = vec![T::default(); self.bands[band].len()];
            of_band(band, &mut sums);
            sums
        };
        let bands: Vec<Vec<T>> = (0..self.bands.len()).into_par_iter().map(of_band).collect();
        let mut total = vec![T::default(); self.stamps.len()];
        for (sum, &index) in bands.iter().flatten().zip(self.bands.iter().flatten()) {
            if *sum != T::default() {
                merge(&mut total[index as usize], sum);
            }
        }
        total
    }
}

/// Adds fragments to the sums of their splats.
struct Sums<'a, T, F> {
    /// By slot.
    sums: &'a mut [T],
    add: F,
}

impl<T, F: Fn(&mut T, &Fragment)> Sink for Sums<'_, T, F> {
    #[inline(always)]
    fn add(&mut self, at: Place, fragments: &FragmentLanes) {
        let sum = &mut self.sums[at.slot];
        fragments.each(at, |_, fragment| (self.add)(sum, &fragment));
    }

    #[inline(always)]
    fn finish(&mut self, _: &Tile) {}
}

/// Visits each pixel with its fragments, front to back.
struct Lists<V> {
    pixels: Vec<Vec<Fragment>>,
    width: usize,
    /// Gets the pixel's index from the band's top left corner, row by row.
    visit: V,
}

impl<V: FnMut(usize, &[Fragment])> Sink for Lists<V> {
    #[inline(always)]
    fn add(&mut self, at: Place, fragments: &FragmentLanes) {
        fragments.each(at, |place, fragment| self.pixels[place].push(fragment));
    }

    #[inline(always)]
    fn finish(&mut self, tile: &Tile) {
        for (place, pixel) in tile.pixels(self.width) {
            (self.visit)(pixel, &self.pixels[place]);
        }
        // Keeps the memory.
        self.pixels.iter_mut().for_each(Vec::clear);
    }
}

/// The traversal of a band.
struct Band<'a, S> {
    walk: &'a Walk,
    band: usize,
    sink: S,
}

impl<S: Sink> NullaryFnOnce for Band<'_, S> {
    type Output = S;

    #[inline(always)]
    fn call(self) -> S {
        let Band { walk, band, mut sink } = self;
        let rows = band * TILE..(band * TILE + TILE).min(walk.height);
        // The slots of the stamps that may overlap each tile.
        let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); walk.width.div_ceil(TILE)];
        for (slot, &index) in walk.bands[band].iter().enumerate() {
            let stamp = &walk.stamps[index as usize];
            for tile in &mut tiles[tiles_between(stamp.center.x, stamp.half_size.x, walk.width)] {
                tile.push(slot as u32);
            }
        }
        for (i, slots) in tiles.iter().enumerate() {
            let columns = i * TILE..(i * TILE + TILE).min(walk.width);
            let mut tile = Tile::new(rows.clone(), columns);
            for (count, &slot) in slots.iter().enumerate() {
                if count % ROUND == 0 && tile.is_finished() {
                    break;
                }
                let stamp = &walk.stamps[walk.bands[band][slot as usize] as usize];
                tile.add(stamp, slot as usize, &mut sink);
            }
            sink.finish(&tile);
        }
        sink
    }
}

/// The pixels of a tile.
pub(super) struct Tile {
    rows: Range<usize>,
    columns: Range<usize>,
    /// Transmittances behind all fragments; below 0, once the pixel is finished.
    transmittance: Plane,
}

impl Tile {
    /// A tile without fragments.
    #[inline(always)]
    fn new(rows: Range<usize>, columns: Range<usize>) -> Tile {
        Tile { rows, columns, transmittance: [1.0; TILE * TILE + LANES] }
    }

    /// The places of the pixels in the tile, row by row, and their indices from the corner of a band of this `width`.
    #[inline(always)]
    fn pixels(&self, width: usize) -> impl Iterator<Item = (usize, usize)> {
        let (left, columns) = (self.columns.start, self.columns.len());
        (0..self.rows.len())
            .flat_map(move |y| (0..columns).map(move |x| (y * TILE + x, y * width + left + x)))
    }

    /// Whether no fragment can be added to any pixel.
    #[inline(always)]
    fn is_finished(&self) -> bool {
        let row = |y: usize| &self.transmittance[y * TILE..][..self.columns.len()];
        (0..self.rows.len()).all(|y| row(y).iter().all(|&transmittance| transmittance < 0.0))
    }

    /// Whether no fragment can be added to the pixel at a place and those right of it.
    #[inline(always)]
    fn is_finished_at(&mut self, pixel: usize) -> bool {
        let mut is_finished = true;
        for &transmittance in lanes_at(&mut self.transmittance, pixel).iter() {
            is_finished &= transmittance < 0.0;
        }
        is_finished
    }

    /// Adds a splat behind all splats so far.
    #[inline(always)]
    fn add(&mut self, stamp: &Stamp, slot: usize, sink: &mut impl Sink) {
        for y in stamp.rows(&self.rows) {
            let dy = y as f64 + 0.5 - stamp.center.y;
            let columns = stamp.columns(dy, &self.columns);
            let row = (y - self.rows.start) * TILE;
            for x in columns.clone().step_by(LANES) {
                let mut dx = [x as f64; LANES];
                for (lane, dx) in dx.iter_mut().enumerate() {
                    *dx = *dx + lane as f64 + 0.5 - stamp.center.x;
                }
                let inside = (columns.end - x) as f64;
                let pixel = row + x - self.columns.start;
                // Most splats of an opaque scene are behind its surface.
                if self.is_finished_at(pixel) {
                    continue;
                }
                let distance_squared = stamp.distance_squared(dx, dy);
                let fragments = self.blend(pixel, inside, stamp.alpha(distance_squared), distance_squared);
                sink.add(Place { index: stamp.index, slot, pixel }, &fragments);
            }
        }
    }

    /// Adds fragments to the pixel at a place and those right of it, to as many as are `inside`.
    #[inline(always)]
    fn blend(&mut self, pixel: usize, inside: f64, alpha: Lanes, distance_squared: Lanes) -> FragmentLanes {
        let rest = lanes_at(&mut self.transmittance, pixel);
        let transmittance = *rest;
        let mut is_drawn = [false; LANES];
        for lane in 0..LANES {
            let behind = transmittance[lane] * (1.0 - alpha[lane]);
            let is_met = ((lane as f64) < inside) & (alpha[lane] >= ALPHA_MIN) & (transmittance[lane] > 0.0);
            is_drawn[lane] = is_met & (behind > TRANSMITTANCE_MIN);
            let finished = pick(is_met, -transmittance[lane], transmittance[lane]);
            rest[lane] = pick(is_drawn[lane], behind, finished);
        }
        FragmentLanes { is_drawn, alpha, transmittance, distance_squared }
    }
}

/// The lanes of a plane from a pixel on.
#[inline(always)]
pub(super) fn lanes_at(plane: &mut Plane, pixel: usize) -> &mut Lanes {
    plane[pixel..].first_chunk_mut().expect("a plane is longer than its tile")
}

/// Tiles along an axis of `size` pixels that an interval around `center` meets.
fn tiles_between(center: f64, half: f64, size: usize) -> Range<usize> {
    // Casts saturate.
    let tile = |pixel: f64| (pixel / TILE as f64).floor();
    let end = (tile(center + half) + 1.0).clamp(0.0, size.div_ceil(TILE) as f64) as usize;
    (tile(center - half).max(0.0) as usize).min(end)..end
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

    /// The `rows` with pixel centres in the box.
    #[inline(always)]
    fn rows(&self, rows: &Range<usize>) -> Range<usize> {
        pixels_between(self.center.y - self.half_size.y, self.center.y + self.half_size.y, rows)
    }

    /// A slight superset of the `columns` with alpha of [`ALPHA_MIN`] or more in the row at `dy`.
    #[inline(always)]
    fn columns(&self, dy: f64, columns: &Range<usize>) -> Range<usize> {
        let half = ((self.far - self.precision.y * dy * dy) / self.precision.x).max(0.0).sqrt();
        let center = self.center.x + self.lean * dy;
        pixels_between(center - half, center + half, columns)
    }

    /// Squared distances in standard deviations at several `dx`.
    #[inline(always)]
    fn distance_squared(&self, dx: Lanes, dy: f64) -> Lanes {
        let mut squares = dx;
        for square in &mut squares {
            let across = *square - self.lean * dy;
            *square = self.precision.y * dy * dy + self.precision.x * across * across;
        }
        squares
    }

    /// `min(0.999, o exp(-q / 2))` at the squared distances `q` in standard deviations.
    #[inline(always)]
    fn alpha(&self, distance_squared: Lanes) -> Lanes {
        let mut exponents = distance_squared;
        for exponent in &mut exponents {
            *exponent *= -0.5;
        }
        let mut alpha = exp(exponents);
        for alpha in &mut alpha {
            *alpha = (self.opacity * *alpha).min(ALPHA_MAX);
        }
        alpha
    }
}

/// The `pixels`, along one axis, with centres in `[start, end]`.
#[inline(always)]
fn pixels_between(start: f64, end: f64, pixels: &Range<usize>) -> Range<usize> {
    // Casts saturate.
    let first = ((start - 0.5).ceil() as usize).clamp(pixels.start, pixels.end);
    let last = ((end + 0.5).floor() as usize).clamp(first, pixels.end);
    first..last
}
