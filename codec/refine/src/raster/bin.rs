//! Stage `bin`: lists the splats of each tile.
//!
//! A splat belongs to the tiles that overlap the ellipse in which it is visible, not its bounding box: per
//! row of tiles, the span of the ellipse within that row.

use std::ops::Range;

use rayon::prelude::*;

use super::project::Splat;
use super::real::Real;

/// Side of a tile in pixels.
pub(crate) const TILE: usize = 16;

/// The tiles of an image, row by row.
#[derive(Clone, Debug)]
pub(crate) struct Tiles {
    /// Width and height of the image in pixels.
    pub(crate) size: [usize; 2],
    /// Tiles per row.
    pub(crate) across: usize,
    rows: Vec<TileRow>,
}

/// The splats of a row of tiles.
#[derive(Clone, Debug)]
struct TileRow {
    /// Index of the first splat of each tile in `splats`, and the end of the last tile.
    starts: Vec<u32>,
    /// Tile by tile, front to back.
    splats: Vec<u32>,
}

impl Tiles {
    /// Bins `splats`, which are sorted front to back.
    pub(crate) fn new<T: Real>(splats: &[Splat<T>], width: u32, height: u32) -> Tiles {
        let (width, height) = (width as usize, height as usize);
        // Every row of tiles goes through all splats, so it reads two numbers of each.
        let heights: Vec<[T; 2]> = splats.par_iter().map(Splat::heights).collect();
        let rows = (0..height.div_ceil(TILE)).into_par_iter();
        let rows =
            rows.map(|row| TileRow::new(splats, &heights, row * TILE..height.min((row + 1) * TILE), width));
        Tiles { size: [width, height], across: width.div_ceil(TILE), rows: rows.collect() }
    }

    /// Number of tiles.
    pub(crate) fn len(&self) -> usize {
        self.across * self.rows.len()
    }

    /// Column and row of a tile's first pixel.
    pub(crate) fn corner(&self, tile: usize) -> [usize; 2] {
        [tile % self.across * TILE, tile / self.across * TILE]
    }

    /// Indices of a tile's splats, front to back and so ascending.
    pub(crate) fn splats(&self, tile: usize) -> &[u32] {
        let row = &self.rows[tile / self.across];
        let column = tile % self.across;
        &row.splats[row.starts[column] as usize..row.starts[column + 1] as usize]
    }
}

impl TileRow {
    /// The row of tiles over these rows of pixels, given the [heights](Splat::heights) of all splats.
    fn new<T: Real>(splats: &[Splat<T>], heights: &[[T; 2]], pixels: Range<usize>, width: usize) -> TileRow {
        let across = width.div_ceil(TILE);
        let half = T::from_f64(0.5);
        let (first, last) = (T::from_f64(pixels.start as f64) + half, T::from_f64(pixels.end as f64) - half);
        let mut spans = Vec::new();
        let mut starts = vec![0; across + 1];
        let in_row = |[top, bottom]: &[T; 2]| *top <= last && *bottom >= first;
        for (index, _) in heights.iter().enumerate().filter(|(_, heights)| in_row(heights)) {
            let Some([left, right]) = splats[index].span(first, last) else { continue };
            let columns = pixels_between(left, right, width);
            if !columns.is_empty() {
                let span = columns.start / TILE..columns.end.div_ceil(TILE);
                starts[span.start + 1..=span.end].iter_mut().for_each(|count| *count += 1);
                spans.push((index as u32, span));
            }
        }
        for column in 0..across {
            starts[column + 1] += starts[column];
        }
        let mut ends = starts.clone();
        let mut by_tile = vec![0; starts[across] as usize];
        for (index, span) in spans {
            for end in &mut ends[span] {
                by_tile[*end as usize] = index;
                *end += 1;
            }
        }
        TileRow { starts, splats: by_tile }
    }
}

impl<T: Real> Splat<T> {
    /// Lowest and highest y of the ellipse.
    fn heights(&self) -> [T; 2] {
        [self.center[1] - self.half_extent[1], self.center[1] + self.half_extent[1]]
    }

    /// Lowest and highest x of the ellipse between two values of y.
    fn span(&self, top: T, bottom: T) -> Option<[T; 2]> {
        let larger = |a: T, b: T| if a > b { a } else { b };
        let smaller = |a: T, b: T| if a < b { a } else { b };
        let top = larger(top - self.center[1], -self.half_extent[1]);
        let bottom = smaller(bottom - self.center[1], self.half_extent[1]);
        if top > bottom {
            return None;
        }
        // Either side of the ellipse is convex: its extreme within the row is at the height closest to
        // where it touches the bounding box.
        let side = |dy: T, sign: T| {
            let rest = larger(self.q_max - self.inverse_variance[1] * dy * dy, T::zero());
            self.center[0] + self.shear * dy + sign * (rest / self.inverse_variance[0]).sqrt()
        };
        let within = |dy: T| smaller(larger(dy, top), bottom);
        Some([side(within(-self.tangent_y), -T::one()), side(within(self.tangent_y), T::one())])
    }
}

/// The pixels, of `size` along an axis, with their centre in `[start, end]`; possibly one more.
pub(crate) fn pixels_between<T: Real>(start: T, end: T, size: usize) -> Range<usize> {
    // Casts truncate and saturate: to 0 below 0 and for NaN.
    let below = |x: T| ((x + T::from_f64(0.5)).to_double() as usize).min(size);
    below(start)..below(end)
}
