//! The grid cells of the Gaussians of a chunk.
//!
//! Cells are numbered along a Morton curve, and the counts of every half, quarter, ... of the curve
//! are coded recursively. So the order of the Gaussians, which has no meaning, takes no bits.

use crate::{
    counters::Work,
    rans::{Attribute, NibbleTree, Prior, Symbols},
};

/// Largest number of bits per axis. Format.
pub(super) const AXIS_BITS_MAX: u32 = 16;

/// Counts below this are coded by one tree; of larger ones only the upper bits adapt. Format.
const SMALL: usize = 32;

/// Number of upper bits of a large count that adapt. Format.
const UPPER_BITS: u32 = 5;

/// Codes the ascending Morton numbers of the cells of a chunk, `3 * axis_bits` bits each.
pub(super) fn code<S: Symbols>(symbols: &mut S, axis_bits: u32, cells: &mut [u64]) {
    let mut small: Vec<NibbleTree> =
        (0..SMALL).map(|n| NibbleTree::new(bits_of(n), Prior::AtMost(n as u32))).collect();
    let mut large: Vec<NibbleTree> =
        (0..=usize::BITS).map(|_| NibbleTree::new(UPPER_BITS, Prior::Nothing)).collect();
    symbols.begin(Attribute::Cells, 0);
    // Simpler codings store a cell per Gaussian.
    cells.iter().for_each(|_| symbols.choice(f64::from(axis_bits).exp2().powi(3)));
    // Stack of runs of the curve to code: first cell, bits left, first row, end row.
    let mut runs = vec![(0u64, 3 * axis_bits, 0, cells.len())];
    while let Some((first, bits, start, end)) = runs.pop() {
        Work::Rows.count(1);
        let rows = &mut cells[start..end];
        match (rows.len(), bits) {
            (0, _) => {}
            (_, 0) => rows.fill(first),
            (1, _) => rows[0] = first | symbols.bypass(bits, rows[0] & ((1 << bits) - 1)),
            (n, _) => {
                let half = first | 1 << (bits - 1);
                let lower = if S::ENCODES { rows.partition_point(|&cell| cell < half) } else { 0 };
                let lower = if n < SMALL {
                    small[n].code(symbols, lower as u32) as usize
                } else {
                    let rest = bits_of(n) - UPPER_BITS;
                    let upper = large[bits_of(n) as usize].code(symbols, (lower >> rest) as u32);
                    let rest_value = symbols.bypass(rest, lower as u64 & ((1 << rest) - 1));
                    (upper as usize) << rest | rest_value as usize
                };
                // More than the run has only in a damaged stream.
                let split = start + lower.min(n);
                runs.push((half, bits - 1, split, end));
                runs.push((first, bits - 1, start, split));
            }
        }
    }
}

/// Bit length of `n`.
fn bits_of(n: usize) -> u32 {
    usize::BITS - n.leading_zeros()
}
