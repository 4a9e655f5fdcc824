//! The grid cells of the Gaussians of a chunk.
//!
//! Cells are numbered along a Morton curve, and the counts of every half, quarter, ... of the curve
//! are coded recursively. So the order of the Gaussians, which has no meaning, takes no bits.

use super::{model::BitTree, observer::Attribute, range::Symbols};
use crate::counters::Work;

/// Largest number of bits per axis. Format.
pub(super) const AXIS_BITS_MAX: u32 = 16;

/// Counts below this are coded by one tree; of larger ones only the upper bits adapt. Format.
const SMALL: usize = 32;

/// Number of upper bits of a large count that adapt. Format.
const UPPER_BITS: u32 = 5;

/// Codes the ascending Morton numbers of the cells of a chunk, `3 * axis_bits` bits each.
pub(super) fn code<S: Symbols>(symbols: &mut S, axis_bits: u32, cells: &mut [u64]) {
    let mut small: Vec<BitTree> = (0..SMALL).map(|n| BitTree::new(bits_of(n))).collect();
    let mut large: Vec<BitTree> = (0..=usize::BITS).map(|_| BitTree::new(UPPER_BITS)).collect();
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

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::context::range::{Decoder, Encoder};

    fn bytes_of(cells: &[u64], axis_bits: u32) -> Vec<u8> {
        let mut sorted = cells.to_vec();
        sorted.sort_unstable();
        let mut encoder = Encoder::new(Vec::new());
        let mut coded = sorted.clone();
        code(&mut encoder, axis_bits, &mut coded);
        assert_eq!(coded, sorted);
        let bytes = encoder.finish();
        let mut decoded = vec![0; cells.len()];
        let mut decoder = Decoder::new(&bytes, ());
        code(&mut decoder, axis_bits, &mut decoded);
        assert_eq!(decoded, sorted);
        assert_eq!((decoder.overrun(), decoder.left()), (false, 0));
        bytes
    }

    #[test]
    fn cells_round_trip() {
        let scattered = |n: u64, bits: u32| -> Vec<u64> {
            (0..n).map(|i| (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - 3 * bits)).collect()
        };
        for (n, bits) in [(1, 16), (2, 1), (31, 4), (33, 7), (4096, 10), (1000, 16)] {
            bytes_of(&scattered(n, bits), bits);
        }
        bytes_of(&[7; 500], 1);
        bytes_of(&[0; 70], 0);
        bytes_of(&[(1 << 48) - 1; 3], 16);
    }

    #[test]
    fn the_order_takes_no_bits() {
        let n = 4096u64;
        let cells: Vec<u64> = (1..=n).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 34).collect();
        let bits = 8.0 * bytes_of(&cells, 10).len() as f64 / n as f64;
        // 30 bits a cell less log2(n!) / n = 10.6.
        assert!((18.5..20.0).contains(&bits), "{bits} bits per cell");
    }
}
