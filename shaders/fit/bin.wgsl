// Stage bin: lists the pairs of a splat and a tile that it overlaps, by the ellipse in which alpha can
// reach ALPHA_MIN, not by its bounding box. Three kernels, with a sort before the last:
//
// count_tiles: tiles of the drawn splats, front to back, summed over blocks of SUM_GROUP.
// list_pairs: the pairs, front to back, so that a stable sort by tile keeps that order within a tile. One group per block,
// one thread per pair.
// find_tiles: the start of each tile among the sorted pairs.
//
// If there are more pairs than `pair_capacity`, the step and all that follow it change nothing, until the host repeats them
// with larger buffers.

@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
// Tiles of the splats of each block.
@group(0) @binding(11) var<storage, read_write> block_sums: array<u32>;
// Rows of the drawn splats, front to back.
@group(0) @binding(12) var<storage, read> order: array<u32>;
// Index of the first sorted pair of each tile, and the end of the last tile.
@group(0) @binding(13) var<storage, read_write> tile_starts: array<u32>;
@group(0) @binding(20) var<storage, read_write> d_pairs: array<f32>;
// By pair: its tile, and the row of its splat. The pairs of a splat are contiguous.
@group(0) @binding(25) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(26) var<storage, read_write> pair_rows: array<u32>;
// Indices of the pairs, to be sorted by tile.
@group(0) @binding(27) var<storage, read_write> tile_pairs: array<u32>;

// Of the splats of the block: the row, and the number of pairs before its own.
var<workgroup> block_rows: array<u32, SUM_GROUP>;
var<workgroup> block_starts: array<u32, SUM_GROUP>;
// Number of pairs of the blocks before.
var<workgroup> block_start: u32;

fn block_of(at: Invocation) -> u32 {
    return at.group.y * at.groups.x + at.group.x;
}

@compute @workgroup_size(SUM_GROUP)
fn count_tiles(at: Invocation) {
    let i = block_of(at) * SUM_GROUP + at.local;
    var tiles = 0u;
    if i < totals[DRAWN] {
        tiles = splats[order[i]].tiles;
    }
    let before = sum_before(at.local, tiles);
    if at.local == SUM_GROUP - 1u && block_of(at) < arrayLength(&block_sums) {
        block_sums[block_of(at)] = plus(before, tiles);
    }
}

// The tile of number `k` of a splat; the number of tiles if it has fewer.
fn tile_of(splat: Splat, k: u32) -> u32 {
    let rows_of_box = tile_rows(splat);
    var left = k;
    for (var tile_row = rows_of_box.start; tile_row < rows_of_box.end; tile_row++) {
        let span = tiles_of_row(splat, tile_row);
        let count = span.end - span.start;
        if left < count {
            return tile_row * uniforms.tiles.x + span.start + left;
        }
        left -= count;
    }
    return uniforms.tiles.x * uniforms.tiles.y;
}

// Index in the block of the splat of the block's pair `k`: the last whose pairs start at `k` or before.
fn splat_of(k: u32) -> u32 {
    var start = 0u;
    for (var size = SUM_GROUP / 2u; size > 0u; size /= 2u) {
        start += select(0u, size, block_starts[start + size] <= k);
    }
    return start;
}

// Leaves the number of all pairs in the totals; after a step with too many for their buffers there are always too many.
fn finish(pairs: u32) {
    let is_halted = totals[HALTED] != 0u;
    totals[PAIRS] = select(pairs, 0xffffffffu, is_halted);
    totals[HALTED] = select(0u, 1u, is_halted || pairs > uniforms.pair_capacity);
}

@compute @workgroup_size(SUM_GROUP)
fn list_pairs(at: Invocation) {
    let block = block_of(at);
    let drawn = totals[DRAWN];
    var of_blocks = 0u;
    for (var other = at.local; other < min(block, arrayLength(&block_sums)); other += SUM_GROUP) {
        of_blocks = plus(of_blocks, block_sums[other]);
    }
    of_blocks = plus(sum_before(at.local, of_blocks), of_blocks);
    if at.local == SUM_GROUP - 1u {
        block_start = of_blocks;
    }
    let first = workgroupUniformLoad(&block_start);
    let i = block * SUM_GROUP + at.local;
    var tiles = 0u;
    if i < drawn {
        block_rows[at.local] = order[i];
        tiles = splats[order[i]].tiles;
    }
    let before = sum_before(at.local, tiles);
    block_starts[at.local] = before;
    if i < drawn {
        splats[order[i]].first_pair = plus(first, before);
    }
    workgroupBarrier();
    let count = sums[SUM_GROUP - 1u];
    if at.local == 0u && block == (max(drawn, 1u) - 1u) / SUM_GROUP {
        finish(plus(first, count));
    }
    for (var k = at.local; k < count; k += SUM_GROUP) {
        let pair = plus(first, k);
        if pair >= uniforms.pair_capacity {
            break;
        }
        let of_block = splat_of(k);
        let row = block_rows[of_block];
        let tile = tile_of(splats[row], k - block_starts[of_block]);
        pair_rows[pair] = row;
        pair_tiles[pair] = tile;
        tile_pairs[pair] = pair;
        // Only on a device that computes other tiles here than in `project`.
        if tile == uniforms.tiles.x * uniforms.tiles.y {
            for (var number = 0u; number < SPLAT_NUMBERS; number++) {
                d_pairs[pair * SPLAT_NUMBERS + number] = 0.0;
            }
        }
    }
}

@compute @workgroup_size(GROUP)
fn find_tiles(at: Invocation) {
    let tile = thread(at);
    if tile > uniforms.tiles.x * uniforms.tiles.y {
        return;
    }
    let pairs = totals[PAIRS];
    var start = 0u;
    var end = select(pairs, 0u, pairs > uniforms.pair_capacity);
    while start < end {
        let middle = (start + end) / 2u;
        if pair_tiles[middle] < tile {
            start = middle + 1u;
        } else {
            end = middle;
        }
    }
    tile_starts[tile] = start;
}
