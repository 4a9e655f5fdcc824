//! [`TimeIndex`]: finds the Gaussians that can be alive at an instant without testing all of them.
//!
//! The rows of a layer's dynamic region are ordered by the length of their alive interval, then by
//! its start. A *cell* is a run of rows of one length octave and one start bin. Octave `k` holds
//! lengths in `(2^-(k+1), 2^-k]` of the clip (the last octave all shorter ones too), so rows of octave
//! `k` that are alive at `t` start in `[t - 2^-k, t]`: a few adjacent cells per octave. About a
//! quarter of the candidates found are not alive.

use std::ops::Range;

use crate::{Field, counters::Work};

/// Number of start bins over the clip.
const BINS: usize = 64;

/// Number of length octaves; the shortest octave is one bin long.
const OCTAVES: usize = 7;

/// Cells of a layer.
pub(crate) const CELLS: usize = OCTAVES * BINS;

/// Tolerance of a cell's edges in clip time. A row this near to an edge may lie on either side, so
/// that rounding in another implementation cannot make a package invalid.
const EDGE: f64 = 1e-6;

/// The rows of the dynamic region that can be alive at a time, for all layers of a clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TimeIndex {
    /// Per layer `CELLS + 1` rising row numbers of the dynamic region: the first row of each cell in
    /// octave-major order, and the end of the last cell.
    layers: Vec<Vec<u32>>,
}

/// The cell of Gaussian `i`, octave-major: `octave * BINS + bin`. A Gaussian that is never alive lies
/// in the shortest octave, in the bin of its window centre.
pub(crate) fn cell_of(field: &Field, i: usize) -> usize {
    let (start, end) = indexed_interval(field, i);
    let octave = (0..OCTAVES - 1).find(|&k| end - start > octave_length(k + 1)).unwrap_or(OCTAVES - 1);
    octave * BINS + bin_of(start)
}

/// Whether Gaussian `i` may lie in a cell, to within [`EDGE`].
fn fits_cell(field: &Field, i: usize, cell: usize) -> bool {
    let (start, end) = indexed_interval(field, i);
    let (octave, bin) = (cell / BINS, cell % BINS);
    let shortest = if octave == OCTAVES - 1 { 0.0 } else { octave_length(octave + 1) };
    let (first, last) = (bin as f64 / BINS as f64, (bin + 1) as f64 / BINS as f64);
    (shortest - EDGE..=octave_length(octave) + EDGE).contains(&(end - start))
        && (first - EDGE..=last + EDGE).contains(&start)
}

/// The alive interval of Gaussian `i`, or the empty one at its window centre.
fn indexed_interval(field: &Field, i: usize) -> (f64, f64) {
    Work::Rows.count(1);
    field.alive_interval(i).unwrap_or_else(|| {
        let tau = field.temporal.as_ref().map_or(0.0, |temporal| f64::from(temporal.tau[i]));
        (tau.clamp(0.0, 1.0), tau.clamp(0.0, 1.0))
    })
}

/// Length of the longest interval of a octave, in clip time.
fn octave_length(octave: usize) -> f64 {
    1.0 / (1u32 << octave) as f64
}

fn bin_of(t: f64) -> usize {
    // The cast takes times before the clip to bin 0.
    ((t * BINS as f64) as usize).min(BINS - 1)
}

/// Numbers per row that sorting a layer needs as scratch space.
pub(crate) const SORTING_NUMBERS: usize = 2;

impl TimeIndex {
    /// Returns an index of one layer that excludes no row: each of `rows` rows is a candidate at any
    /// time, in any order.
    ///
    /// # Panics
    /// If `rows` exceeds 32 bits.
    pub fn of_candidates(rows: usize) -> TimeIndex {
        // Intervals as long as the clip, from its start.
        let mut counts = [0; CELLS];
        counts[0] = u32::try_from(rows).expect("rows fit u32");
        let mut index = TimeIndex::default();
        index.push_layer(&counts);
        index
    }

    /// Adds a layer, given the number of rows in each of its 448 cells in octave-major order.
    ///
    /// # Panics
    /// If there are not 448 counts, or a row number exceeds 32 bits.
    pub fn push_layer(&mut self, counts: &[u32]) {
        assert_eq!(counts.len(), CELLS, "one count per cell");
        let mut row = self.end();
        let mut starts = Vec::with_capacity(counts.len() + 1);
        starts.push(row);
        for &count in counts {
            row = row.checked_add(count).expect("rows fit u32");
            starts.push(row);
        }
        self.layers.push(starts);
    }

    /// Row behind the last one.
    fn end(&self) -> u32 {
        self.layers.last().and_then(|layer| layer.last()).copied().unwrap_or(0)
    }

    /// Adds the layers of `further`, whose row numbers count from the first row behind the rows of this index.
    ///
    /// # Panics
    /// If a row number exceeds 32 bits.
    pub fn append(&mut self, further: TimeIndex) {
        let first = self.end();
        for mut layer in further.layers {
            layer.iter_mut().for_each(|row| *row = row.checked_add(first).expect("rows fit u32"));
            self.layers.push(layer);
        }
    }

    /// The index of the layers from layer `first` on, counted from 0, with row numbers that count from their first row:
    /// what [`TimeIndex::append`] adds to the index of the layers before.
    pub fn since(&self, first: usize) -> TimeIndex {
        let layers = self.layers.get(first..).unwrap_or_default();
        let start = layers.first().and_then(|layer| layer.first()).copied().unwrap_or(0);
        TimeIndex {
            layers: layers.iter().map(|layer| layer.iter().map(|row| row - start).collect()).collect(),
        }
    }

    /// Sorts the rows of another layer of the dynamic region by cell, stably, and adds the layer.
    /// `scratch` has a capacity of [`SORTING_NUMBERS`] per row.
    pub(crate) fn sort_layer(&mut self, field: &mut Field, rows: Range<usize>, scratch: &mut Vec<u32>) {
        let mut counts = [0; CELLS];
        scratch.clear();
        scratch.resize(SORTING_NUMBERS * rows.len(), 0);
        let (positions, scratch) = scratch.split_at_mut(rows.len());
        positions.iter_mut().zip(rows.clone()).for_each(|(cell, row)| *cell = cell_of(field, row) as u32);
        positions.iter().for_each(|&cell| counts[cell as usize] += 1);
        let mut next = [0; CELLS];
        for cell in 1..CELLS {
            next[cell] = next[cell - 1] + counts[cell - 1];
        }
        // Replaces cells by positions within the layer.
        for cell in positions.iter_mut() {
            let next = &mut next[*cell as usize];
            *cell = *next;
            *next += 1;
        }
        field.move_rows(rows.start, positions, scratch);
        self.push_layer(&counts);
    }

    /// The first row of the last layer added that lies in the wrong cell.
    pub(crate) fn first_misplaced(&self, field: &Field) -> Option<usize> {
        let starts = self.layers.last()?;
        (0..CELLS).find_map(|cell| {
            (starts[cell] as usize..starts[cell + 1] as usize).find(|&row| !fits_cell(field, row, cell))
        })
    }

    /// Returns ranges of rows of the dynamic region in the first `layers` layers that contain every
    /// row alive at clip time `t`. Ranges are disjoint and ascending. `t` is cut to `[0, 1]`.
    pub fn candidates(&self, t: f64, layers: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let t = t.clamp(0.0, 1.0);
        let last = bin_of(t + EDGE);
        self.layers.iter().take(layers).flat_map(move |starts| {
            (0..OCTAVES).filter_map(move |octave| {
                let first = bin_of(t - octave_length(octave) - 3.0 * EDGE);
                let range = starts[octave * BINS + first] as usize..starts[octave * BINS + last + 1] as usize;
                (!range.is_empty()).then_some(range)
            })
        })
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::Temporal;

    /// A field of windows given as opacity, centre and width, sorted by cell, and its index.
    fn indexed(mut windows: Vec<(f32, f32, f32)>) -> (Field, TimeIndex) {
        let field_of = |windows: &[(f32, f32, f32)]| Field {
            centers: vec![[0.0; 3]; windows.len()],
            opacities: windows.iter().map(|w| w.0).collect(),
            temporal: Some(Temporal {
                tau: windows.iter().map(|w| w.1).collect(),
                s: windows.iter().map(|w| w.2).collect(),
                ..Temporal::default()
            }),
            ..Field::default()
        };
        windows.sort_by_cached_key(|window| cell_of(&field_of(&[*window]), 0));
        let field = field_of(&windows);
        let mut counts = [0; CELLS];
        (0..field.len()).for_each(|i| counts[cell_of(&field, i)] += 1);
        let mut index = TimeIndex::default();
        index.push_layer(&counts);
        (field, index)
    }

    /// Numbers in `[0, 1)` from a small generator.
    fn uniform() -> impl FnMut() -> f32 {
        let mut state = 1u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f32 / (1u64 << 24) as f32
        }
    }

    #[test]
    fn candidates_contain_every_alive_row_and_few_others() {
        let mut uniform = uniform();
        // Widths spread evenly over the orders of magnitude, 0.003 to 1.
        let windows: Vec<_> =
            (0..20_000).map(|_| (uniform(), 1.2 * uniform() - 0.1, 10f32.powf(-2.5 * uniform()))).collect();
        let (field, index) = indexed(windows);
        assert_eq!(index.first_misplaced(&field), None);
        let (mut candidates, mut alive) = (0, 0);
        for step in 0..=1000 {
            let t = f64::from(step) / 1000.0;
            let mut is_candidate = vec![false; field.len()];
            for range in index.candidates(t, 1) {
                is_candidate[range].fill(true);
            }
            for (i, is_candidate) in is_candidate.into_iter().enumerate() {
                let is_alive = field.opacity_at(i, t) >= crate::ALPHA_MIN;
                assert!(is_candidate || !is_alive, "row {i} is alive at {t} but no candidate");
                candidates += usize::from(is_candidate);
                alive += usize::from(is_alive);
            }
        }
        let waste = 1.0 - alive as f64 / candidates as f64;
        assert!((0.0..0.3).contains(&waste), "{waste} of the candidates are not alive");
    }

    #[test]
    fn windows_on_cell_edges_are_found() {
        // Intervals that start or end exactly on a bin, or are exactly as long as a octave: opacity
        // e^2 / 255 puts the ends at tau -+ 2 s.
        let opacity = (1f64.exp().powi(2) / 255.0) as f32;
        let mut windows = Vec::new();
        for bin in 0..=BINS {
            for octave in 0..OCTAVES {
                let (start, half) = (bin as f32 / BINS as f32, 0.5 * octave_length(octave) as f32);
                windows.push((opacity, start + half, 0.5 * half));
                windows.push((opacity, start - half, 0.5 * half));
            }
        }
        let (field, index) = indexed(windows);
        for i in 0..field.len() {
            let Some((start, end)) = field.alive_interval(i) else {
                continue;
            };
            for t in [start, 0.5 * (start + end), end] {
                assert!(index.candidates(t, 1).any(|range| range.contains(&i)), "row {i} at {t}");
            }
        }
    }

    #[test]
    fn a_row_on_an_edge_may_lie_on_either_side() {
        let (field, _) = indexed(vec![(1.0, 0.5, 1e-5)]);
        let (start, _) = field.alive_interval(0).unwrap();
        let edge = (start * BINS as f64).ceil() / BINS as f64;
        let shifted = |by: f64| {
            let tau = (edge - start + by) as f32 + 0.5;
            indexed(vec![(1.0, tau, 1e-5)]).0
        };
        let last = (OCTAVES - 1) * BINS + (edge * BINS as f64) as usize;
        // Within the tolerance a row fits both neighbours, outside only one.
        let both = shifted(0.0);
        assert!(fits_cell(&both, 0, last) && fits_cell(&both, 0, last - 1));
        let after = shifted(1e-4);
        assert!(fits_cell(&after, 0, last) && !fits_cell(&after, 0, last - 1));
        let before = shifted(-1e-4);
        assert!(!fits_cell(&before, 0, last) && fits_cell(&before, 0, last - 1));
        // The octave counts as well.
        assert!(!fits_cell(&after, 0, last - BINS));
    }

    #[test]
    fn an_index_of_candidates_excludes_no_row() {
        let index = TimeIndex::of_candidates(5);
        for t in [-1.0, 0.0, 0.3, 1.0, 2.0] {
            assert!(index.candidates(t, 1).eq(std::iter::once(0..5)), "at {t}");
        }
        assert_eq!(TimeIndex::of_candidates(0).candidates(0.5, 1).count(), 0);
    }

    #[test]
    fn row_numbers_continue_across_layers() {
        let mut counts = [0; CELLS];
        counts[3] = 2;
        let mut index = TimeIndex::default();
        index.push_layer(&counts);
        index.push_layer(&counts);
        let all: Vec<_> = index.candidates(0.05, 2).collect();
        assert_eq!(all, [0..2, 2..4]);
        assert!(index.candidates(0.05, 1).eq(std::iter::once(0..2)));
        assert_eq!(index.candidates(0.0, 2).count(), 0, "bin 3 starts at 3 / 64");
    }
}
