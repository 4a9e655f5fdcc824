//! Stage `bin`: which splats reach which tile.
//!
//! Tiles are tested against the ellipse in which a splat can be seen, not against its box: for each
//! row of tiles, how far the ellipse reaches to either side within that row.

use std::ops::Range;

use rayon::prelude::*;

use super::project::Splat;
use crate::fit::precision::Real;

/// Side of a tile in pixels.
pub(super) const TILE: usize = 16;

/// The tiles of a picture, row by row.
#[derive(Clone, Debug)]
pub(super) struct Tiles {
    /// Tiles per row.
    across: usize,
    /// Per row of tiles, its splats.
    rows: Vec<TileRow>,
}

#[derive(Clone, Debug)]
struct TileRow {
    /// Where the splats of each tile begin in `splats`, and where the last ones end.
    starts: Vec<u32>,
    /// Tile by tile.
    splats: Vec<u32>,
}

impl Tiles {
    /// Of splats sorted front to back.
    pub(super) fn new<T: Real>(splats: &[Splat<T>], width: u32, height: u32) -> Tiles {
        let (width, height) = (width as usize, height as usize);
        let rows = (0..height.div_ceil(TILE)).into_par_iter();
        let rows = rows.map(|row| TileRow::new(splats, row * TILE..height.min((row + 1) * TILE), width));
        Tiles { across: width.div_ceil(TILE), rows: rows.collect() }
    }

    /// Number of tiles.
    pub(super) fn len(&self) -> usize {
        self.across * self.rows.len()
    }

    /// Column and row of a tile's first pixel.
    pub(super) fn corner(&self, tile: usize) -> [usize; 2] {
        [tile % self.across * TILE, tile / self.across * TILE]
    }

    /// Indices of a tile's splats, front to back and so rising.
    pub(super) fn splats(&self, tile: usize) -> &[u32] {
        let row = &self.rows[tile / self.across];
        let column = tile % self.across;
        &row.splats[row.starts[column] as usize..row.starts[column + 1] as usize]
    }
}

impl TileRow {
    /// Of the row of tiles with the given rows of pixels.
    fn new<T: Real>(splats: &[Splat<T>], pixels: Range<usize>, width: usize) -> TileRow {
        let across = width.div_ceil(TILE);
        let half = T::from_f64(0.5);
        let (first, last) = (T::from_f64(pixels.start as f64) + half, T::from_f64(pixels.end as f64) - half);
        let mut spans = Vec::new();
        let mut starts = vec![0; across + 1];
        for (index, splat) in splats.iter().enumerate() {
            let Some([left, right]) = splat.extent(first, last) else { continue };
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
        let mut of_tiles = vec![0; starts[across] as usize];
        for (index, span) in spans {
            for end in &mut ends[span] {
                of_tiles[*end as usize] = index;
                *end += 1;
            }
        }
        TileRow { starts, splats: of_tiles }
    }
}

impl<T: Real> Splat<T> {
    /// From where to where in x the ellipse reaches between two values of y.
    fn extent(&self, top: T, bottom: T) -> Option<[T; 2]> {
        let larger = |a: T, b: T| if a > b { a } else { b };
        let smaller = |a: T, b: T| if a < b { a } else { b };
        let top = larger(top - self.center[1], -self.reach[1]);
        let bottom = smaller(bottom - self.center[1], self.reach[1]);
        if top > bottom {
            return None;
        }
        // Either side of an ellipse is curved to one side: farthest as near to where it touches its
        // box as can be.
        let side = |dy: T, sign: T| {
            let left_over = larger(self.far - self.precision[1] * dy * dy, T::zero());
            self.center[0] + self.lean * dy + sign * (left_over / self.precision[0]).sqrt()
        };
        let within = |dy: T| smaller(larger(dy, top), bottom);
        Some([side(within(-self.touch), -T::one()), side(within(self.touch), T::one())])
    }
}

/// Those of `size` pixels along one axis whose centres lie in `[start, end]`, or one more.
pub(super) fn pixels_between<T: Real>(start: T, end: T, size: usize) -> Range<usize> {
    // Conversions cut off what is behind the point, and saturate: at 0, and there also for NaN.
    let before = |x: T| ((x + T::from_f64(0.5)).to_double() as usize).min(size);
    before(start)..before(end)
}
