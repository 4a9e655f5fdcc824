// Stage project_backward: from the gradient by splats to that by parameters.
//
// Each Gaussian is projected once more and followed back, by itself. What its gradient tells about it is
// noted on the way.

@group(0) @binding(3) var<storage, read_write> state: array<atomic<u32>>;
// Rows of the splats that were drawn.
@group(0) @binding(12) var<storage, read> order: array<u32>;
// By row.
@group(0) @binding(5) var<storage, read> splats: array<Splat>;
// By pair, SPLAT_NUMBERS each.
@group(0) @binding(20) var<storage, read> d_pairs: array<f32>;
// Row `i` is the gradient by row `order[i]` of the parameters; the columns are theirs.
@group(0) @binding(21) var<storage, read_write> d_parameters: array<f32>;
// By row.
@group(0) @binding(22) var<storage, read_write> memory: array<Memory>;

// What has become of a gradient, number by number.
struct Health {
    is_finite: bool,
    // Whether the squares are finite, too.
    is_usable: bool,
}

fn put(health: ptr<function, Health>, at: u32, value: f32) {
    d_parameters[at] = value;
    (*health).is_finite = (*health).is_finite && is_finite(value);
    (*health).is_usable = (*health).is_usable && is_finite(value * value);
}

fn put_vector(health: ptr<function, Health>, at: u32, value: vec3<f32>) {
    put(health, at, value.x);
    put(health, at + 1u, value.y);
    put(health, at + 2u, value.z);
}

fn put_quaternion(health: ptr<function, Health>, at: u32, value: vec4<f32>) {
    put_vector(health, at, value.xyz);
    put(health, at + 3u, value.w);
}

// From the rotation matrix to the quaternion before it is brought to length 1.
fn quaternion_backward(projected: Projected, g: array<vec3<f32>, 3>) -> vec4<f32> {
    if projected.length <= 0.0 {
        return vec4<f32>(0.0);
    }
    let q = projected.rotation;
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    // Off the diagonal, what the matrix and its transpose have in common, and what not.
    let xy = g[0].y + g[1].x;
    let xz = g[0].z + g[2].x;
    let yz = g[1].z + g[2].y;
    let turn = vec3<f32>(g[2].y - g[1].z, g[0].z - g[2].x, g[1].x - g[0].y);
    let by_unit = vec4<f32>(
        2.0 * (x * turn.x + y * turn.y + z * turn.z),
        2.0 * (y * xy + z * xz + w * turn.x) - 4.0 * x * (g[1].y + g[2].z),
        2.0 * (x * xy + z * yz + w * turn.y) - 4.0 * y * (g[0].x + g[2].z),
        2.0 * (x * xz + y * yz + w * turn.z) - 4.0 * z * (g[0].x + g[1].y),
    );
    return (by_unit - dot(by_unit, q) * q) / projected.length;
}

@compute @workgroup_size(GROUP)
fn project_backward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = thread(group, groups, local);
    if i >= atomicLoad(&state[DRAWN]) || atomicLoad(&state[PAIRS]) > step.pair_capacity {
        return;
    }
    let row = order[i];
    let window = window_of(row);
    var projected: Projected;
    if !project_into(row, window, &projected) {
        // Only where a device computes the same numbers twice differently.
        memory[row].is_usable = 0u;
        return;
    }
    let splat = projected.splat;

    // The sums that `rasterize_backward` left, of all tiles, and the gradient by what a splat is.
    var sums = array<f32, SPLAT_NUMBERS>();
    let first = splats[row].first_pair;
    for (var pair = first; pair < first + splats[row].tiles; pair++) {
        for (var k = 0u; k < SPLAT_NUMBERS; k++) {
            sums[k] += d_pairs[pair * SPLAT_NUMBERS + k];
        }
    }
    let e = sums[0];
    let es = sums[1];
    let ey = sums[2];
    let ess = sums[3];
    let esy = sums[4];
    let eyy = sums[5];
    var d_color = vec3<f32>(sums[6], sums[7], sums[8]);
    let p = splat.inverse;
    let lean = splat.lean;
    let d_center = vec2<f32>(p.x * es, p.y * ey - lean * p.x * es);
    let d_inverse = -0.5 * vec2<f32>(ess, eyy);

    // From the footprint to the Gaussian's axes in the image. The variance of x where y is known is
    // xx - xy^2 / yy, and lean is xy / yy.
    let d_variance = -p.x * p.x * d_inverse.x;
    let d_lean = p.x * esy / projected.variance_y;
    let d_xx = d_variance;
    let d_xy = d_lean - 2.0 * lean * d_variance;
    let d_yy = lean * lean * d_variance - lean * d_lean - p.y * p.y * d_inverse.y;
    let x_image = projected.images[0];
    let y_image = projected.images[1];
    let d_images = array<vec3<f32>, 2>(
        x_image * (2.0 * d_xx) + y_image * d_xy,
        y_image * (2.0 * d_yy) + x_image * d_xy,
    );

    // To the centre and the axes in the camera's.
    let z = projected.view.z;
    var d_view = vec3<f32>(0.0);
    var d_axes = array<vec3<f32>, 3>();
    for (var axis = 0u; axis < 2u; axis++) {
        let f = step.focal[axis] / z;
        d_axes[axis] = d_images[axis] * f;
        d_axes[2] += d_images[axis] * (-f * projected.slope[axis]);
        // The image is proportional to f.
        d_view.z -= dot(d_images[axis], projected.images[axis]) / z;
        var d_slope = d_center[axis] * step.focal[axis];
        if projected.is_inside[axis] {
            d_slope -= f * dot(d_images[axis], projected.axes[2]);
        }
        d_view[axis] = d_slope / z;
        d_view.z -= d_slope * (projected.view[axis] / z) / z;
    }
    var d_world = from_view(d_view);

    var health = Health(true, true);
    let n = step.gaussians;
    // To the colour. A channel cut off at 0 does not follow its coefficients.
    d_color = select(vec3<f32>(0.0), d_color, splat.color > vec3<f32>(0.0));
    let basis = harmonics(projected.direction);
    let sh = place(n, START_SH, COUNT_SH, i);
    var weights = array<f32, 16>();
    for (var k = 0u; k < HARMONICS; k++) {
        put_vector(&health, sh + 3u * k, d_color * basis[k]);
        weights[k] = dot(harmonic_of(row, k), d_color);
    }
    if HARMONICS > 1u && projected.distance > 0.0 {
        let d_direction = harmonics_backward(projected.direction, weights);
        let along = dot(d_direction, projected.direction);
        d_world += (d_direction - projected.direction * along) / projected.distance;
    }

    // To the scales and the rotation: in the world, the axes times the deviations are R S.
    let turned = rows_of_rotation(projected.rotation);
    let x_axis = step.view_from_world[0];
    let y_axis = step.view_from_world[1];
    let z_axis = step.view_from_world[2];
    var d_turned: array<vec3<f32>, 3>;
    var d_log_scale = vec3<f32>(0.0);
    for (var r = 0u; r < 3u; r++) {
        d_turned[r] = (d_axes[0] * x_axis[r] + d_axes[1] * y_axis[r] + d_axes[2] * z_axis[r]) * projected.scales;
        d_log_scale += d_turned[r] * turned[r];
    }
    put_vector(&health, place(n, START_LOG_SCALE, COUNT_LOG_SCALE, i), d_log_scale);
    let d_rotation = quaternion_backward(projected, d_turned);
    put_quaternion(&health, place(n, START_ROTATION, COUNT_ROTATION, i), d_rotation);

    // To the trajectory.
    let d = window.since;
    put_vector(&health, place(n, START_CENTER, COUNT_CENTER, i), d_world);
    var d_since = 0.0;
    var power = 1.0;
    for (var k = 0u; k < MOTION_ORDER; k++) {
        d_since += f32(k + 1u) * power * dot(d_world, motion_of(row, k));
        power *= d;
        put_vector(&health, place(n, START_MOTION, COUNT_MOTION, i) + 3u * k, d_world * power);
    }
    if TURNS {
        put_quaternion(&health, place(n, START_ROTATION_RATE, COUNT_ROTATION_RATE, i), d_rotation * d);
        d_since += dot(d_rotation, rotation_rate_of(row));
    }

    // To the window: o = sigmoid(a) exp(-z^2 / 2), z = d / s.
    put(&health, place(n, START_LOGIT, 1u, i), e * window.clearness);
    if IS_TIMED {
        let in_widths = window.since_in_widths;
        put(&health, place(n, START_LOG_WIDTH, 1u, i), e * in_widths * in_widths);
        var d_tau = e * in_widths / window.width;
        if step.is_detached == 0u {
            d_tau -= d_since;
        }
        put(&health, place(n, START_TAU, 1u, i), d_tau);
    }

    // Of the centre in the image, counted from -1 to 1.
    let on_screen = d_center * vec2<f32>(step.size) * 0.5;
    let pull = sqrt(dot(on_screen, on_screen));
    note(i, row, pull, health);
}

// Clears a gradient that is not finite, counts it, and notes what the control of their number asks for.
fn note(i: u32, row: u32, pull: f32, health: Health) {
    let is_good = health.is_finite && is_finite(pull);
    if !is_good {
        for (var column = 0u; column < COLUMNS; column++) {
            let first = place(step.gaussians, START[column], COUNT[column], i);
            for (var k = 0u; k < COUNT[column]; k++) {
                d_parameters[first + k] = 0.0;
            }
        }
    }
    let is_usable = !is_good || health.is_usable;
    if !(is_good && is_usable) {
        atomicAdd(&state[NON_FINITE], 1u);
    }
    let kept = select(0.0, pull, is_good);
    memory[row].pull += kept;
    memory[row].pictures += 1u;
    memory[row].visits += select(0u, 1u, is_usable);
    memory[row].is_usable = select(0u, 1u, is_usable);
}
