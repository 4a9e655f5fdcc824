// Stage project_backward: backpropagates the gradient from splats to parameters, one thread per drawn
// Gaussian, which is projected again for its intermediate results.
//
// In: the sums that `rasterize_backward` left per pair. Out: row `i` of the gradient is the gradient of row
// `order[i]` of the parameters, 0 if it is not finite; where the camera is learned, the gradient with respect to the view,
// summed over each group. Updates the statistics.

@group(0) @binding(3) var<storage, read_write> totals: array<atomic<u32>>;
// Rows of the drawn splats.
@group(0) @binding(12) var<storage, read> order: array<u32>;
// By row.
@group(0) @binding(5) var<storage, read> splats: array<Splat>;
// By pair, SPLAT_NUMBERS each.
@group(0) @binding(20) var<storage, read> d_pairs: array<f32>;
@group(0) @binding(21) var<storage, read_write> d_parameters: array<f32>;
@group(0) @binding(22) var<storage, read_write> statistics: array<Statistics>;
// By group of threads.
@group(0) @binding(18) var<storage, read_write> view_sums: array<ViewGradient>;

var<workgroup> views: array<ViewGradient, GROUP>;

// Gradient with respect to a splat.
struct SplatGradient {
    center: vec2<f32>,
    inverse_variance: vec2<f32>,
    shear: f32,
    color: vec3<f32>,
    // With respect to the logarithm of the opacity.
    log_opacity: f32,
}

// Whether the numbers of a gradient are finite, and whether their squares are, too.
struct Health {
    is_finite: bool,
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

// Sums the pairs of a splat.
fn splat_backward(row: u32, splat: Splat) -> SplatGradient {
    var sums = array<f32, SPLAT_NUMBERS>();
    let first = splats[row].first_pair;
    for (var pair = first; pair < first + splats[row].tiles; pair++) {
        for (var k = 0u; k < SPLAT_NUMBERS; k++) {
            sums[k] += d_pairs[pair * SPLAT_NUMBERS + k];
        }
    }
    // The exponent is -q / 2; the sums are sums of its gradient times 1, s, dy, s s, s dy, dy dy.
    let inverse_variance = splat.inverse_variance;
    return SplatGradient(
        vec2<f32>(inverse_variance.x * sums[1], inverse_variance.y * sums[2] - splat.shear * inverse_variance.x * sums[1]),
        -0.5 * vec2<f32>(sums[3], sums[5]),
        inverse_variance.x * sums[4],
        vec3<f32>(sums[6], sums[7], sums[8]),
        sums[0],
    );
}

// To the images x and y of the axes. The variance of x given y is xx - xy^2 / yy, and shear is xy / yy. Compensated
// opacity has the factor sqrt(A / D), with A = |x x y|^2 and D = A + b (|x|^2 + |y|^2) + b^2 for a filter of variance b.
fn images_backward(projected: Projected, d_splat: SplatGradient) -> array<vec3<f32>, 2> {
    let inverse_variance = projected.splat.inverse_variance;
    let shear = projected.splat.shear;
    let d_variance = -inverse_variance.x * inverse_variance.x * d_splat.inverse_variance.x;
    let d_shear = d_splat.shear / projected.footprint.variance.y;
    let d_xx = d_variance;
    let d_xy = d_shear - 2.0 * shear * d_variance;
    let d_yy = shear * shear * d_variance - shear * d_shear
        - inverse_variance.y * inverse_variance.y * d_splat.inverse_variance.y;
    let images = projected.footprint.images;
    var d_images = array<vec3<f32>, 2>(
        images[0] * (2.0 * d_xx) + images[1] * d_xy,
        images[1] * (2.0 * d_yy) + images[0] * d_xy,
    );
    if COMPENSATES {
        let footprint = projected.footprint;
        let area = footprint.area;
        // 1 / A - 1 / D is b (|x|^2 + |y|^2 + b) / (A D), and half the derivatives of A are y x (x x y) and
        // (x x y) x x: neither cancels.
        let by_filter = d_splat.log_opacity * FILTER / footprint.determinant;
        let by_area = by_filter * (footprint.variance.x + footprint.variance.y - FILTER) / dot(area, area);
        d_images[0] += cross(images[1], area) * by_area - images[0] * by_filter;
        d_images[1] += cross(area, images[0]) * by_area - images[1] * by_filter;
    }
    return d_images;
}

// To the scaled axes in camera space and the logarithm of the focal lengths. Returns the gradient with respect to the
// centre there.
fn view_backward(
    projected: Projected,
    d_splat: SplatGradient,
    d_axes: ptr<function, array<vec3<f32>, 3>>,
    log_focal: ptr<function, f32>,
) -> vec3<f32> {
    let d_images = images_backward(projected, d_splat);
    let z = projected.view.z;
    var d_view = vec3<f32>(0.0);
    for (var axis = 0u; axis < 2u; axis++) {
        let f = uniforms.focal[axis] / z;
        // The centre and the image are proportional to it.
        *log_focal += d_splat.center[axis] * f * projected.view[axis]
            + dot(d_images[axis], projected.footprint.images[axis]);
        (*d_axes)[axis] = d_images[axis] * f;
        (*d_axes)[2] += d_images[axis] * (-f * projected.footprint.slope[axis]);
        // The image is proportional to f.
        d_view.z -= dot(d_images[axis], projected.footprint.images[axis]) / z;
        var d_slope = d_splat.center[axis] * uniforms.focal[axis];
        if projected.footprint.is_inside[axis] {
            d_slope -= f * dot(d_images[axis], projected.axes[2]);
        }
        d_view[axis] = d_slope / z;
        d_view.z -= d_slope * (projected.view[axis] / z) / z;
    }
    return d_view;
}

// To the spherical harmonics. Returns the gradient with respect to the position. A clamped channel keeps only a
// gradient that leads back between 0 and 1.
fn color_backward(
    health: ptr<function, Health>,
    i: u32,
    row: u32,
    projected: Projected,
    d_unclamped: vec3<f32>,
) -> vec3<f32> {
    let color = projected.splat.color;
    let d_lifted = select(d_unclamped, min(d_unclamped, vec3<f32>(0.0)), color <= vec3<f32>(0.0));
    let d_color = select(d_lifted, max(d_unclamped, vec3<f32>(0.0)), color >= vec3<f32>(1.0));
    let basis = harmonics(projected.direction);
    let sh = place(uniforms.gaussians, START_SH, COUNT_SH, i);
    var weights = array<f32, 16>();
    for (var k = 0u; k < HARMONICS; k++) {
        put_vector(health, sh + 3u * k, d_color * basis[k]);
        weights[k] = dot(harmonic_of(row, k), d_color);
    }
    if HARMONICS == 1u || !(projected.distance > 0.0) {
        return vec3<f32>(0.0);
    }
    let d_direction = harmonics_backward(projected.direction, weights);
    let along = dot(d_direction, projected.direction);
    return (d_direction - projected.direction * along) / projected.distance;
}

// From the rotation matrix to the quaternion before its normalisation.
fn quaternion_backward(projected: Projected, g: array<vec3<f32>, 3>) -> vec4<f32> {
    if projected.length <= 0.0 {
        return vec4<f32>(0.0);
    }
    let q = projected.rotation;
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    // The symmetric and the antisymmetric part off the diagonal.
    let xy = g[0].y + g[1].x;
    let xz = g[0].z + g[2].x;
    let yz = g[1].z + g[2].y;
    let skew = vec3<f32>(g[2].y - g[1].z, g[0].z - g[2].x, g[1].x - g[0].y);
    let by_unit = vec4<f32>(
        2.0 * (x * skew.x + y * skew.y + z * skew.z),
        2.0 * (y * xy + z * xz + w * skew.x) - 4.0 * x * (g[1].y + g[2].z),
        2.0 * (x * xy + z * yz + w * skew.y) - 4.0 * y * (g[0].x + g[2].z),
        2.0 * (x * xz + y * yz + w * skew.z) - 4.0 * z * (g[0].x + g[1].y),
    );
    return (by_unit - dot(by_unit, q) * q) / projected.length;
}

// To scales and rotation: the scaled axes in the world are R S. Returns the gradient of the quaternion.
fn axes_backward(
    health: ptr<function, Health>,
    i: u32,
    projected: Projected,
    d_axes: array<vec3<f32>, 3>,
) -> vec4<f32> {
    let rotated = rows_of_rotation(projected.rotation);
    let x_axis = uniforms.view_from_world[0];
    let y_axis = uniforms.view_from_world[1];
    let z_axis = uniforms.view_from_world[2];
    var d_rotated: array<vec3<f32>, 3>;
    var d_log_scale = vec3<f32>(0.0);
    for (var r = 0u; r < 3u; r++) {
        let d_world = d_axes[0] * x_axis[r] + d_axes[1] * y_axis[r] + d_axes[2] * z_axis[r];
        d_rotated[r] = d_world * projected.scales;
        d_log_scale += d_rotated[r] * rotated[r];
    }
    let n = uniforms.gaussians;
    put_vector(health, place(n, START_LOG_SCALE, COUNT_LOG_SCALE, i), d_log_scale);
    let d_rotation = quaternion_backward(projected, d_rotated);
    put_quaternion(health, place(n, START_ROTATION, COUNT_ROTATION, i), d_rotation);
    return d_rotation;
}

// To the trajectory and the rotation rate. Returns the derivative with respect to the time since tau.
fn motion_backward(
    health: ptr<function, Health>,
    i: u32,
    row: u32,
    d: f32,
    d_world: vec3<f32>,
    d_rotation: vec4<f32>,
) -> f32 {
    let n = uniforms.gaussians;
    put_vector(health, place(n, START_CENTER, COUNT_CENTER, i), d_world);
    var d_since = 0.0;
    var power = 1.0;
    for (var k = 0u; k < MOTION_ORDER; k++) {
        d_since += f32(k + 1u) * power * dot(d_world, motion_of(row, k));
        power *= d;
        put_vector(health, place(n, START_MOTION, COUNT_MOTION, i) + 3u * k, d_world * power);
    }
    if ROTATES {
        put_quaternion(health, place(n, START_ROTATION_RATE, COUNT_ROTATION_RATE, i), d_rotation * d);
        d_since += dot(d_rotation, rotation_rate_of(row));
    }
    return d_since;
}

// To logit, width and tau: o = sigmoid(a) exp(-z^2 / 2) with z = d / s. Returns the derivative of the fading with
// respect to tau.
fn window_backward(
    health: ptr<function, Health>,
    i: u32,
    window: Window,
    d_log_opacity: f32,
    d_since: f32,
) -> f32 {
    let n = uniforms.gaussians;
    put(health, place(n, START_LOGIT, 1u, i), d_log_opacity * window.clearness);
    if !IS_TIMED {
        return 0.0;
    }
    let z = window.since_in_widths;
    put(health, place(n, START_LOG_WIDTH, 1u, i), d_log_opacity * z * z);
    let fading = d_log_opacity * z / window.width;
    put(health, place(n, START_TAU, 1u, i), select(fading, fading - d_since, uniforms.detach_tau == 0u));
    return fading;
}

// What is turned about the camera's centre: the centre and the axes, in camera space.
fn rotation_backward(projected: Projected, d_view: vec3<f32>, d_axes: array<vec3<f32>, 3>) -> vec3<f32> {
    var sum = cross(projected.view, d_view);
    for (var axis = 0u; axis < 3u; axis++) {
        sum += cross(
            vec3<f32>(projected.axes[0][axis], projected.axes[1][axis], projected.axes[2][axis]),
            vec3<f32>(d_axes[0][axis], d_axes[1][axis], d_axes[2][axis]),
        );
    }
    return sum;
}

// Clears and counts a gradient that is not finite, and updates the statistics. Returns whether it is finite.
fn finish(i: u32, row: u32, screen_gradient: f32, health: Health) -> bool {
    let is_good = health.is_finite && is_finite(screen_gradient);
    if !is_good {
        for (var column = 0u; column < COLUMNS; column++) {
            let first = place(uniforms.gaussians, START[column], COUNT[column], i);
            for (var k = 0u; k < COUNT[column]; k++) {
                d_parameters[first + k] = 0.0;
            }
        }
    }
    let is_usable = !is_good || health.is_usable;
    if !(is_good && is_usable) {
        atomicAdd(&totals[NON_FINITE], 1u);
    }
    statistics[row].screen_gradient += select(0.0, screen_gradient, is_good);
    statistics[row].images += 1u;
    statistics[row].visits += select(0u, 1u, is_usable);
    statistics[row].is_usable = select(0u, 1u, is_usable);
    return is_good;
}

// Leaves the gradient of drawn Gaussian `i` with respect to its parameters; returns the one with respect to the view.
fn gaussian_backward(i: u32) -> ViewGradient {
    let row = order[i];
    let window = window_of(row);
    var projected: Projected;
    if !project_into(row, window, &projected) {
        // Only on a device that computes the same numbers differently in `project`.
        statistics[row].is_usable = 0u;
        return ViewGradient();
    }
    let d_splat = splat_backward(row, projected.splat);
    var health = Health(true, true);
    var d_axes = array<vec3<f32>, 3>();
    var log_focal = 0.0;
    var d_view = view_backward(projected, d_splat, &d_axes, &log_focal);
    // Derivative of the logarithm of the fade.
    if projected.view.z < uniforms.near {
        d_view.z += d_splat.log_opacity / (projected.view.z - FADE_START * uniforms.near);
    }
    var d_world = from_view(d_view);
    d_world += color_backward(&health, i, row, projected, d_splat.color);
    let d_rotation = axes_backward(&health, i, projected, d_axes);
    let d_since = motion_backward(&health, i, row, window.since, d_world, d_rotation);
    let fading = window_backward(&health, i, window, d_splat.log_opacity, d_since);
    let turned = rotation_backward(projected, d_view, d_axes);
    // The image spans [-1, 1] along both axes.
    let on_screen = d_splat.center * vec2<f32>(uniforms.size) * 0.5;
    if !finish(i, row, sqrt(dot(on_screen, on_screen)), health) {
        return ViewGradient();
    }
    return ViewGradient(turned, d_since - fading, d_world, log_focal);
}

// Sums the gradients of the threads of a group with respect to the view.
fn sum_views(at: Invocation, by_view: ViewGradient) {
    views[at.local] = by_view;
    for (var stride = GROUP / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if at.local < stride {
            let other = views[at.local + stride];
            views[at.local].rotation += other.rotation;
            views[at.local].time += other.time;
            views[at.local].center += other.center;
            views[at.local].log_focal += other.log_focal;
        }
    }
    let group = thread(at) / GROUP;
    if at.local == 0u && group < arrayLength(&view_sums) {
        view_sums[group] = views[0];
    }
}

@compute @workgroup_size(GROUP)
fn project_backward(at: Invocation) {
    let i = thread(at);
    var by_view = ViewGradient();
    if i < atomicLoad(&totals[DRAWN]) && atomicLoad(&totals[PAIRS]) <= uniforms.pair_capacity {
        by_view = gaussian_backward(i);
    }
    if uniforms.learns_camera != 0u {
        sum_views(at, by_view);
    }
}
