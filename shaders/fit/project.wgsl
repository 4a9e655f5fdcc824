// Stage project: the splats that can reach a pixel, and by what they are sorted.

// By row.
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
// The bits of the depth, which rise with it; NOT_DRAWN of what is not drawn.
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> rows: array<u32>;

@compute @workgroup_size(GROUP)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let row = thread(group, groups, local);
    if row >= step.gaussians {
        return;
    }
    rows[row] = row;
    var projected: Projected;
    if !project_into(row, window_of(row), &projected) {
        keys[row] = NOT_DRAWN;
        return;
    }
    keys[row] = bitcast<u32>(projected.depth);
    var splat = projected.splat;
    let of_box = tile_rows(splat);
    for (var tile_row = of_box.start; tile_row < of_box.end; tile_row++) {
        let span = tiles_of_row(splat, tile_row);
        splat.tiles += span.end - span.start;
    }
    splats[row] = splat;
}
