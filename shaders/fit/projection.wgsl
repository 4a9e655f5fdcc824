// Moves Gaussians to the instant and projects them into the image: what `project` writes, and what
// `project_backward` follows back.
//
// The footprint is the affine approximation of EWA splatting (Zwicker et al. 2001) in the form of gsplat.

// The window of a Gaussian at the instant.
struct Window {
    // Opacity at the instant, and how much the peak opacity lacks to 1.
    opacity: f32,
    clearness: f32,
    // Frames since `tau`, also in widths of the window; 0 without time.
    since: f32,
    since_in_widths: f32,
    // Width in frames; 1 without time.
    width: f32,
}

struct Projected {
    splat: Splat,
    // Distance of the centre along the camera's axis.
    depth: f32,
    // Unit vector from the eye to the centre (0 where they are one), and the distance.
    direction: vec3<f32>,
    distance: f32,
    // Unit quaternion w, x, y, z, and the length it had; 0 where it was too short to have a direction.
    rotation: vec4<f32>,
    length: f32,
    scales: vec3<f32>,
    // Centre in the camera's axes.
    view: vec3<f32>,
    // x/z and y/z at which the Jacobian is taken, and whether that is at the centre.
    slope: vec2<f32>,
    is_inside: vec2<bool>,
    // Along the camera's x, y and z: the Gaussian's three axes times their standard deviations.
    axes: array<vec3<f32>, 3>,
    // In the image's x and y: the same, in pixels.
    images: array<vec3<f32>, 2>,
    // Of y, blur included.
    variance_y: f32,
}

// e^x, finite for all numbers; 0 far below 0, NaN for NaN.
fn exponential(x: f32) -> f32 {
    if is_nan(x) {
        return x;
    }
    return select(exp(clamp(x, -87.3, 88.0)), 0.0, x < -87.3);
}

// Rotates into the camera's axes, and back.
fn to_view(v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(step.view_from_world[0].xyz, v),
        dot(step.view_from_world[1].xyz, v),
        dot(step.view_from_world[2].xyz, v),
    );
}

fn from_view(v: vec3<f32>) -> vec3<f32> {
    return step.view_from_world[0].xyz * v.x
        + step.view_from_world[1].xyz * v.y
        + step.view_from_world[2].xyz * v.z;
}

fn window_of(row: u32) -> Window {
    var window = Window(0.0, 0.0, 0.0, 0.0, 1.0);
    if IS_TIMED {
        window.since = step.frame - number_of(row, START_TAU);
        window.width = exponential(number_of(row, START_LOG_WIDTH));
    }
    window.since_in_widths = window.since / window.width;
    let fading = exponential(-0.5 * window.since_in_widths * window.since_in_widths);
    let logit = number_of(row, START_LOGIT);
    window.opacity = fading / (1.0 + exponential(-logit));
    window.clearness = 1.0 / (1.0 + exponential(logit));
    return window;
}

// mu + c1 d + c2 d^2 + c3 d^3, the paper's trajectory.
fn position(row: u32, d: f32) -> vec3<f32> {
    var offset = vec3<f32>(0.0);
    for (var power = MOTION_ORDER; power > 0u; power--) {
        offset = (offset + motion_of(row, power - 1u)) * d;
    }
    return center_of(row) + offset;
}

// The rows of the rotation matrix of a unit quaternion w, x, y, z.
fn rows_of_rotation(q: vec4<f32>) -> array<vec3<f32>, 3> {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return array<vec3<f32>, 3>(
        vec3<f32>(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        vec3<f32>(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        vec3<f32>(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
}

// Projects a Gaussian; whether it can reach a pixel. Not so what is not there at the instant, what is
// nearer than NEAR, and what has no finite footprint.
fn project_into(row: u32, window: Window, out: ptr<function, Projected>) -> bool {
    if !(is_finite(window.opacity) && window.opacity >= ALPHA_MIN) {
        return false;
    }
    let world = position(row, window.since);
    let origin = vec3<f32>(step.view_from_world[0].w, step.view_from_world[1].w, step.view_from_world[2].w);
    let view = to_view(world) + origin;
    let z = view.z;
    if !(is_finite(z) && z >= NEAR) {
        return false;
    }
    let f = step.focal / z;
    let center = f * view.xy + step.principal;

    var q = rotation_of(row);
    if TURNS {
        q += rotation_rate_of(row) * window.since;
    }
    let length = sqrt(dot(q, q));
    if !is_finite(length) {
        return false;
    }
    let has_direction = length > LENGTH_MIN;
    let rotation = select(vec4<f32>(1.0, 0.0, 0.0, 0.0), q / length, has_direction);
    let log_scale = log_scale_of(row);
    let scales = vec3<f32>(exponential(log_scale.x), exponential(log_scale.y), exponential(log_scale.z));
    let turned = rows_of_rotation(rotation);
    let in_world = array<vec3<f32>, 3>(turned[0] * scales, turned[1] * scales, turned[2] * scales);
    var axes: array<vec3<f32>, 3>;
    for (var r = 0u; r < 3u; r++) {
        let axis = step.view_from_world[r];
        axes[r] = in_world[0] * axis.x + in_world[1] * axis.y + in_world[2] * axis.z;
    }
    let at_center = view.xy / z;
    let slope = min(max(at_center, step.slope_min), step.slope_max);
    // Rows of the Jacobian times the axes.
    let x_image = (axes[0] - axes[2] * slope.x) * f.x;
    let y_image = (axes[1] - axes[2] * slope.y) * f.y;
    // |a|^2 |b|^2 - (a . b)^2 is |a x b|^2, which does not cancel.
    let area = cross(x_image, y_image);
    let sharp = vec2<f32>(dot(x_image, x_image), dot(y_image, y_image));
    let xy = dot(x_image, y_image);
    let determinant = dot(area, area) + BLUR * (sharp.x + sharp.y) + BLUR * BLUR;
    let xx = sharp.x + BLUR;
    let yy = sharp.y + BLUR;

    let gaze = world - step.eye;
    let distance = sqrt(dot(gaze, gaze));
    let direction = select(vec3<f32>(0.0), gaze / distance, distance > 0.0);
    let basis = harmonics(direction);
    var color = vec3<f32>(0.5);
    for (var k = 0u; k < HARMONICS; k++) {
        color += harmonic_of(row, k) * basis[k];
    }
    let is_usable = is_finite(center.x) && is_finite(center.y) && are_finite(color)
        && is_finite(distance) && is_finite(determinant);
    if !is_usable {
        return false;
    }
    // A margin above the rounding of the exponential.
    let far = max(2.0 * log(window.opacity / ALPHA_MIN), 0.0) + FAR_MARGIN;
    let reach = sqrt(far * vec2<f32>(xx, yy));
    let size = vec2<f32>(step.size);
    if !(all(center + reach > vec2<f32>(0.0)) && all(center - reach < size)) {
        return false;
    }
    (*out).splat = Splat(
        center,
        vec2<f32>(yy / determinant, 1.0 / yy),
        reach,
        xy / yy,
        far,
        max(color, vec3<f32>(0.0)),
        window.opacity,
        reach.x * (xy / xx),
        0u,
        0u,
    );
    (*out).depth = z;
    (*out).direction = direction;
    (*out).distance = distance;
    (*out).rotation = rotation;
    (*out).length = select(0.0, length, has_direction);
    (*out).scales = scales;
    (*out).view = view;
    (*out).slope = slope;
    (*out).is_inside = at_center == slope;
    (*out).axes = axes;
    (*out).images = array<vec3<f32>, 2>(x_image, y_image);
    (*out).variance_y = yy;
    return true;
}
