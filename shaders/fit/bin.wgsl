// Stage bin: which splats reach which tile. Tiles are tested against the ellipse in which a splat can be
// seen, not against its box.

@group(0) @binding(3) var<storage, read> state: array<u32>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
// By pair: the tile, and the row of the splat that reaches it. Those of a splat follow one another.
@group(0) @binding(25) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(26) var<storage, read_write> pair_rows: array<u32>;
// Numbers of the pairs, to be sorted by tile.
@group(0) @binding(27) var<storage, read_write> tile_pairs: array<u32>;
// How many tiles each drawn splat reaches; then how many those in front reach.
@group(0) @binding(10) var<storage, read_write> counts: array<u32>;
@group(0) @binding(11) var<storage, read> block_sums: array<u32>;
// Rows of the splats that are drawn, front to back.
@group(0) @binding(12) var<storage, read> order: array<u32>;
// Where the pairs of each tile begin, and where the last ones end.
@group(0) @binding(13) var<storage, read_write> tile_starts: array<u32>;

@compute @workgroup_size(GROUP)
fn count_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = thread(group, groups, local);
    if i < state[DRAWN] {
        counts[i] = splats[order[i]].tiles;
    }
}

// Front to back, so that the pairs of each tile stay so when they are sorted by tile.
@compute @workgroup_size(GROUP)
fn list_pairs(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = thread(group, groups, local);
    if i >= state[DRAWN] || state[PAIRS] > step.pair_capacity {
        return;
    }
    let row = order[i];
    let splat = splats[row];
    var to = counts[i] + block_sums[i / BLOCK];
    let of_box = tile_rows(splat);
    let end = to + splat.tiles;
    splats[row].first_pair = to;
    for (var pair = to; pair < end; pair++) {
        pair_rows[pair] = row;
        tile_pairs[pair] = pair;
    }
    for (var tile_row = of_box.start; tile_row < of_box.end; tile_row++) {
        let span = tiles_of_row(splat, tile_row);
        // The bound holds by itself where a device computes the same numbers twice alike.
        for (var column = span.start; column < span.end && to < end; column++) {
            pair_tiles[to] = tile_row * step.tiles.x + column;
            to++;
        }
    }
    // Pairs of no tile have no gradient.
    splats[row].tiles = to - splats[row].first_pair;
    for (; to < end; to++) {
        pair_tiles[to] = step.tiles.x * step.tiles.y;
    }
}

// Of pairs that are sorted by tile.
@compute @workgroup_size(GROUP)
fn find_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = thread(group, groups, local);
    if tile > step.tiles.x * step.tiles.y {
        return;
    }
    let pairs = state[PAIRS];
    var start = 0u;
    var end = select(pairs, 0u, pairs > step.pair_capacity);
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
