// Evaluates Gaussians at the frame and projects them into the image: `project` stores the splat,
// `project_backward` recomputes all intermediate results.
//
// The footprint is the affine approximation of EWA splatting (Zwicker et al. 2001) in the form of gsplat.

// The temporal window of a Gaussian at the frame.
struct Window {
    // Opacity at the frame, before it fades near the camera, not compensated; 1 minus the peak opacity.
    opacity: f32,
    clearness: f32,
    // Time since tau in intervals, and in window widths; 0 without time.
    since: f32,
    since_in_widths: f32,
    // Width in intervals; 1 without time.
    width: f32,
}

// The affine approximation of a Gaussian in the image.
struct Footprint {
    // x/z and y/z at which the Jacobian is evaluated, and whether those are the centre's.
    slope: vec2<f32>,
    is_inside: vec2<bool>,
    // Images of the Gaussian's scaled axes in x and in y, in pixels.
    images: array<vec3<f32>, 2>,
    // Variances of x and y with the filter in px^2, their covariance, and the determinant.
    variance: vec2<f32>,
    covariance: f32,
    determinant: f32,
    // Cross product of the images, whose square is the determinant without filter.
    area: vec3<f32>,
}

struct Projected {
    splat: Splat,
    // Unit vector from the camera to the centre (0 if they coincide), and the distance.
    direction: vec3<f32>,
    distance: f32,
    // Unit quaternion w, x, y, z, and its length before normalisation; 0 if that is too short.
    rotation: vec4<f32>,
    length: f32,
    scales: vec3<f32>,
    // Centre in camera space.
    view: vec3<f32>,
    // Camera-space x, y and z of the three axes times their standard deviations.
    axes: array<vec3<f32>, 3>,
    footprint: Footprint,
}

// e^x: finite for all numbers, 0 below -87.3, NaN for NaN.
fn finite_exp(x: f32) -> f32 {
    if is_nan(x) {
        return x;
    }
    return select(exp(clamp(x, -87.3, 88.0)), 0.0, x < -87.3);
}

// Rotates a vector from world to camera space.
fn to_view(v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(uniforms.view_from_world[0].xyz, v),
        dot(uniforms.view_from_world[1].xyz, v),
        dot(uniforms.view_from_world[2].xyz, v),
    );
}

// Rotates a vector from camera to world space.
fn from_view(v: vec3<f32>) -> vec3<f32> {
    return uniforms.view_from_world[0].xyz * v.x
        + uniforms.view_from_world[1].xyz * v.y
        + uniforms.view_from_world[2].xyz * v.z;
}

fn window_of(row: u32) -> Window {
    var window = Window(0.0, 0.0, 0.0, 0.0, 1.0);
    if IS_TIMED {
        window.since = uniforms.time - scalar_of(row, START_TAU);
        window.width = finite_exp(scalar_of(row, START_LOG_WIDTH));
    }
    window.since_in_widths = window.since / window.width;
    let fading = finite_exp(-0.5 * window.since_in_widths * window.since_in_widths);
    let logit = scalar_of(row, START_LOGIT);
    window.opacity = fading / (1.0 + finite_exp(-logit));
    window.clearness = 1.0 / (1.0 + finite_exp(logit));
    return window;
}

// The paper's trajectory: mu + c1 d + c2 d^2 + c3 d^3.
fn position(row: u32, d: f32) -> vec3<f32> {
    var offset = vec3<f32>(0.0);
    for (var power = MOTION_ORDER; power > 0u; power--) {
        offset = (offset + motion_of(row, power - 1u)) * d;
    }
    return center_of(row) + offset;
}

// Rows of the rotation matrix of a unit quaternion w, x, y, z.
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

// Computes rotation, scales and axes. Returns false for a quaternion that is not finite.
fn orient(row: u32, since: f32, out: ptr<function, Projected>) -> bool {
    var q = rotation_of(row);
    if ROTATES {
        q += rotation_rate_of(row) * since;
    }
    let length = sqrt(dot(q, q));
    if !is_finite(length) {
        return false;
    }
    let has_direction = length > LENGTH_MIN;
    let rotation = select(vec4<f32>(1.0, 0.0, 0.0, 0.0), q / length, has_direction);
    let log_scale = log_scale_of(row);
    let scales = vec3<f32>(finite_exp(log_scale.x), finite_exp(log_scale.y), finite_exp(log_scale.z));
    let rotated = rows_of_rotation(rotation);
    let in_world = array<vec3<f32>, 3>(rotated[0] * scales, rotated[1] * scales, rotated[2] * scales);
    for (var r = 0u; r < 3u; r++) {
        let axis = uniforms.view_from_world[r];
        (*out).axes[r] = in_world[0] * axis.x + in_world[1] * axis.y + in_world[2] * axis.z;
    }
    (*out).rotation = rotation;
    (*out).length = select(0.0, length, has_direction);
    (*out).scales = scales;
    return true;
}

// The footprint of scaled axes at `view`.
fn footprint_of(view: vec3<f32>, axes: array<vec3<f32>, 3>) -> Footprint {
    let f = uniforms.focal / view.z;
    let at_center = view.xy / view.z;
    let slope = min(max(at_center, uniforms.slope_min), uniforms.slope_max);
    // Rows of the Jacobian times the axes.
    let x_image = (axes[0] - axes[2] * slope.x) * f.x;
    let y_image = (axes[1] - axes[2] * slope.y) * f.y;
    // |a|^2 |b|^2 - (a . b)^2 is |a x b|^2, which does not cancel.
    let area = cross(x_image, y_image);
    let sharp = vec2<f32>(dot(x_image, x_image), dot(y_image, y_image));
    let determinant = dot(area, area) + FILTER * (sharp.x + sharp.y) + FILTER * FILTER;
    return Footprint(
        slope,
        at_center == slope,
        array<vec3<f32>, 2>(x_image, y_image),
        sharp + vec2<f32>(FILTER),
        dot(x_image, y_image),
        determinant,
        area,
    );
}

// 0.5 plus the sum of the spherical harmonics; a splat has its positive part.
fn color_of(row: u32, direction: vec3<f32>) -> vec3<f32> {
    let basis = harmonics(direction);
    var color = vec3<f32>(0.5);
    for (var k = 0u; k < HARMONICS; k++) {
        color += harmonic_of(row, k) * basis[k];
    }
    return color;
}

// Projects a Gaussian. Returns false if it reaches no pixel: it is invisible at the frame, faded near
// the camera, outside the image, compensated to nothing, or not finite.
fn project_into(row: u32, window: Window, out: ptr<function, Projected>) -> bool {
    if !(is_finite(window.opacity) && window.opacity >= ALPHA_MIN) {
        return false;
    }
    let world = position(row, window.since);
    let translation = vec3<f32>(
        uniforms.view_from_world[0].w,
        uniforms.view_from_world[1].w,
        uniforms.view_from_world[2].w,
    );
    let view = to_view(world) + translation;
    var opacity = window.opacity * near_fade(view.z, uniforms.near);
    if !(is_finite(view.z) && opacity >= ALPHA_MIN) || !orient(row, window.since, out) {
        return false;
    }
    let footprint = footprint_of(view, (*out).axes);
    let gaze = world - uniforms.eye;
    let distance = sqrt(dot(gaze, gaze));
    let direction = select(vec3<f32>(0.0), gaze / distance, distance > 0.0);
    let color = color_of(row, direction);
    let center = uniforms.focal / view.z * view.xy + uniforms.principal;
    if !(is_finite(center.x) && is_finite(center.y) && are_finite(color) && is_finite(distance)
        && is_finite(footprint.determinant)) {
        return false;
    }
    if COMPENSATES {
        opacity *= sqrt(dot(footprint.area, footprint.area) / footprint.determinant);
        if !(opacity >= ALPHA_MIN) {
            return false;
        }
    }
    // The margin exceeds the rounding error of the finite_exp.
    let q_max = max(2.0 * log(opacity / ALPHA_MIN), 0.0) + Q_MARGIN;
    let half_extent = sqrt(q_max * footprint.variance);
    if !(all(center + half_extent > vec2<f32>(0.0)) && all(center - half_extent < vec2<f32>(uniforms.size))) {
        return false;
    }
    let xx = footprint.variance.x;
    let yy = footprint.variance.y;
    (*out).splat = Splat(
        center,
        vec2<f32>(yy / footprint.determinant, 1.0 / yy),
        half_extent,
        footprint.covariance / yy,
        q_max,
        clamp(color, vec3<f32>(0.0), vec3<f32>(1.0)),
        opacity,
        half_extent.x * (footprint.covariance / xx),
        0u,
        0u,
    );
    (*out).direction = direction;
    (*out).distance = distance;
    (*out).view = view;
    (*out).footprint = footprint;
    return true;
}
