// Stage project: projects every Gaussian, one thread each.
//
// In: parameters and statistics. Out: by row, its splat and the number of tiles that it overlaps; a sort key that
// ascends with depth, above all others for what lies behind them (NOT_DRAWN for a Gaussian that reaches no pixel); its
// row.

@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> rows: array<u32>;
@group(0) @binding(22) var<storage, read> statistics: array<Statistics>;

@compute @workgroup_size(GROUP)
fn project(at: Invocation) {
    let row = thread(at);
    if row >= uniforms.gaussians {
        return;
    }
    rows[row] = row;
    var projected: Projected;
    if !project_into(row, window_of(row), &projected) {
        keys[row] = NOT_DRAWN;
        return;
    }
    // The bits of positive floats ascend with their values, and the first of them is 0.
    keys[row] = bitcast<u32>(projected.view.z) | (statistics[row].is_behind << 31u);
    var splat = projected.splat;
    let rows_of_box = tile_rows(splat);
    for (var tile_row = rows_of_box.start; tile_row < rows_of_box.end; tile_row++) {
        let span = tiles_of_row(splat, tile_row);
        splat.tiles += span.end - span.start;
    }
    splats[row] = splat;
}
