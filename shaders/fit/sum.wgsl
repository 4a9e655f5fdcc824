// Stage sum: what a step leaves for the host, one group. The loss, from the sums of the tiles, and, where the camera is learned,
// the gradient with respect to the camera: of its response from the same sums, of the view from the sums that
// `project_backward` leaves.

@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
@group(0) @binding(16) var<storage, read> tile_sums: array<f32>;
@group(0) @binding(18) var<storage, read> view_sums: array<ViewGradient>;
// Time, rotation, translation, logarithm of the focal lengths, colours, vignette.
@group(0) @binding(29) var<storage, read_write> d_camera: array<f32>;

// Numbers of the view, which are before the response's in `d_camera`.
const VIEW_NUMBERS: u32 = 8u;

var<workgroup> parts: array<f32, SUM_GROUP>;

// Sums a number over the threads of the group.
fn summed(local: u32, number: f32) -> f32 {
    workgroupBarrier();
    parts[local] = number;
    for (var stride = SUM_GROUP / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if local < stride {
            parts[local] += parts[local + stride];
        }
    }
    workgroupBarrier();
    return parts[0];
}

// Sums a number over the tiles.
fn sum_of_tiles(local: u32, number: u32) -> f32 {
    var sum = 0.0;
    for (var tile = local; tile < uniforms.tiles.x * uniforms.tiles.y; tile += SUM_GROUP) {
        sum += tile_sums[tile * TILE_NUMBERS + number];
    }
    return summed(local, sum);
}

fn sum_views(local: u32) {
    var sum: ViewGradient;
    let groups = (totals[DRAWN] + GROUP - 1u) / GROUP;
    for (var i = local; i < groups; i += SUM_GROUP) {
        sum.rotation += view_sums[i].rotation;
        sum.time += view_sums[i].time;
        sum.center += view_sums[i].center;
        sum.log_focal += view_sums[i].log_focal;
    }
    let center = vec4<f32>(sum.center, 0.0);
    var numbers = array<f32, VIEW_NUMBERS>(
        sum.time,
        sum.rotation.x,
        sum.rotation.y,
        sum.rotation.z,
        dot(uniforms.view_from_world[0], center),
        dot(uniforms.view_from_world[1], center),
        dot(uniforms.view_from_world[2], center),
        sum.log_focal,
    );
    for (var number = 0u; number < VIEW_NUMBERS; number++) {
        let total = summed(local, numbers[number]);
        if local == 0u {
            d_camera[number] = total;
        }
    }
}

@compute @workgroup_size(SUM_GROUP)
fn sum_step(at: Invocation) {
    for (var number = 0u; number < TILE_NUMBERS; number++) {
        if number >= 2u && uniforms.learns_camera == 0u {
            break;
        }
        let sum = sum_of_tiles(at.local, number);
        if at.local == 0u {
            if number < 2u {
                totals[ABSOLUTE + number] = bitcast<u32>(sum);
            } else {
                d_camera[VIEW_NUMBERS + number - 2u] = sum;
            }
        }
    }
    if uniforms.learns_camera != 0u {
        sum_views(at.local);
    }
}
