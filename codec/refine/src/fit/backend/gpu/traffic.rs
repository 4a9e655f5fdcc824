//! [`touched_bytes`]: what the kernels of a step read and write.

use shaders::fit::layout::{Statistics, Totals};
use shaders::fit::{SPLAT_BYTES, SPLAT_NUMBERS};

use super::buffers::{Buffers, DEPTH_BITS, passes, tiles};

/// Bytes per number.
const WORD: u64 = 4;

/// Bytes that a step touches: each kernel reads what it needs once and writes its results once, as if its own caches were
/// perfect and it shared none with the others.
pub(super) fn touched_bytes(buffers: &Buffers, totals: &Totals, size: [u32; 2]) -> u64 {
    let [rows, drawn, pairs] = [totals.gaussians, totals.drawn, totals.pairs].map(u64::from);
    let numbers = u64::from(buffers.gaussians.columns.numbers());
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let [across, down] = tiles(size);
    let tiles = u64::from(across * down);
    let row = WORD * numbers;
    let (of_pair, of_statistics) = (u64::from(SPLAT_NUMBERS) * WORD, size_of::<Statistics>() as u64);
    // Keys are read twice, their values once; both are written once.
    let sort = |read: u64, written: u64| 3 * WORD * read + 2 * WORD * written;
    let sort_by_depth = sort(rows, drawn) + (passes(DEPTH_BITS) as u64 - 1) * sort(drawn, drawn);
    let sort_by_tile = passes(buffers.tile_bits()) as u64 * sort(pairs, pairs);
    // All windows, the numbers of what is drawn, and a key and a row of each.
    let project = 3 * WORD * rows + drawn * (row + SPLAT_BYTES) + 2 * WORD * rows;
    let bin = drawn * (2 * SPLAT_BYTES + 3 * WORD) + 3 * WORD * pairs + WORD * (pairs + tiles);
    let rasterize = drawn * SPLAT_BYTES + 2 * WORD * pairs + 4 * WORD * pixels;
    // The image and the photograph twice, nine derivatives, the gradient.
    let loss = pixels * WORD * (2 * (4 + 1) + 2 * 9 + 4);
    let rasterize_backward = rasterize + 4 * WORD * pixels + of_pair * pairs;
    let project_backward = drawn * (2 * row + SPLAT_BYTES + 2 * of_statistics) + of_pair * pairs;
    let adam = drawn * (7 * row + of_statistics);
    project
        + sort_by_depth
        + bin
        + sort_by_tile
        + rasterize
        + loss
        + rasterize_backward
        + project_backward
        + adam
}
