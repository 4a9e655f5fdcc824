// Stage bin: lists the pairs of a splat and a tile that it overlaps, by the ellipse in which alpha can
// reach ALPHA_MIN, not by its bounding box. Three kernels, with a scan and a sort between them:
//
// count_tiles: tiles per drawn splat, front to back; a scan turns them into the index of its first pair.
// list_pairs: the pairs, front to back, so that a stable sort by tile keeps that order within a tile.
// find_tiles: the start of each tile among the sorted pairs.
//
// If there are more pairs than `pair_capacity`, none are listed and the host retries with larger buffers.

@group(0) @binding(3) var<storage, read> totals: array<u32>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
// By pair: its tile, and the row of its splat. The pairs of a splat are contiguous.
@group(0) @binding(25) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(26) var<storage, read_write> pair_rows: array<u32>;
// Indices of the pairs, to be sorted by tile.
@group(0) @binding(27) var<storage, read_write> tile_pairs: array<u32>;
// Tiles per drawn splat; after the scan, their sum over the splats before it in its block.
@group(0) @binding(10) var<storage, read_write> counts: array<u32>;
@group(0) @binding(11) var<storage, read> block_sums: array<u32>;
// Rows of the drawn splats, front to back.
@group(0) @binding(12) var<storage, read> order: array<u32>;
// Index of the first sorted pair of each tile, and the end of the last tile.
@group(0) @binding(13) var<storage, read_write> tile_starts: array<u32>;

@compute @workgroup_size(GROUP)
fn count_tiles(at: Invocation) {
    let i = thread(at);
    if i < totals[DRAWN] {
        counts[i] = splats[order[i]].tiles;
    }
}

@compute @workgroup_size(GROUP)
fn list_pairs(at: Invocation) {
    let i = thread(at);
    if i >= totals[DRAWN] || totals[PAIRS] > uniforms.pair_capacity {
        return;
    }
    let row = order[i];
    let splat = splats[row];
    var next = counts[i] + block_sums[i / BLOCK];
    let rows_of_box = tile_rows(splat);
    let end = next + splat.tiles;
    splats[row].first_pair = next;
    for (var pair = next; pair < end; pair++) {
        pair_rows[pair] = row;
        tile_pairs[pair] = pair;
    }
    for (var tile_row = rows_of_box.start; tile_row < rows_of_box.end; tile_row++) {
        let span = tiles_of_row(splat, tile_row);
        // `next < end` always holds on a device that computes the same span here as in `project`.
        for (var column = span.start; column < span.end && next < end; column++) {
            pair_tiles[next] = tile_row * uniforms.tiles.x + column;
            next++;
        }
    }
    // On other devices, surplus pairs go to no tile and have no gradient.
    splats[row].tiles = next - splats[row].first_pair;
    for (; next < end; next++) {
        pair_tiles[next] = uniforms.tiles.x * uniforms.tiles.y;
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
