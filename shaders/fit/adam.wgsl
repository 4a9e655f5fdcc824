// Stage adam: one step of Adam (Kingma and Ba, "Adam", 2015) within the bounds, for the Gaussians that the
// image shows. A thread takes numbers of drawn rows; one takes all of a quaternion, of the three scales, or of a window's
// width with the motion.
//
// In: gradients, learning rates, bounds, statistics. In and out: parameters, moments. Bias correction
// counts the gradients of each row, not the steps.

struct AdamUniforms {
    // Learning rates by column, and at SH_REST of the spherical harmonics of degrees 1 to 3. Motion has the rate
    // of the centre.
    rates: array<vec4<f32>, 3>,
    // Smallest and largest log-scale, log-width and tau; the largest logit.
    log_scales: vec2<f32>,
    log_widths: vec2<f32>,
    tau: vec2<f32>,
    logit_max: f32,
    // Weight of the area of the drawn Gaussians in the loss.
    fragment_weight: f32,
    // Longest reach of a window, in intervals.
    reach_max: f32,
}

@group(0) @binding(2) var<uniform> adam_uniforms: AdamUniforms;
@group(0) @binding(3) var<storage, read> totals: array<u32>;
@group(0) @binding(4) var<storage, read_write> parameters: array<f32>;
@group(0) @binding(12) var<storage, read> order: array<u32>;
@group(0) @binding(21) var<storage, read> d_parameters: array<f32>;
@group(0) @binding(22) var<storage, read> statistics: array<Statistics>;
@group(0) @binding(23) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(24) var<storage, read_write> second_moments: array<f32>;

// 1 / (1 - beta^visits), given the logarithm of beta.
fn correction(log_beta: f32, visits: u32) -> f32 {
    let x = log_beta * f32(visits);
    if x < -0.5 {
        return 1.0 / (1.0 - exp(x));
    }
    // 1 - e^x near 0 as a series with a remainder below 2^-24.
    var sum = 1.0;
    for (var k = 8.0; k > 1.0; k -= 1.0) {
        sum = 1.0 + sum * x / k;
    }
    return -1.0 / (x * sum);
}

// Updates the moments of a parameter with its gradient `g` and returns its next value.
fn updated(at: u32, g: f32, rate: f32, bias: vec2<f32>) -> f32 {
    let first = BETA1 * first_moments[at] + (1.0 - BETA1) * g;
    let second = BETA2 * second_moments[at] + (1.0 - BETA2) * g * g;
    first_moments[at] = first;
    second_moments[at] = second;
    return parameters[at] - rate * (first * bias.x) / (sqrt(second * bias.y) + EPSILON);
}

// Clamps a number of `column` to its bounds; NaN stays.
fn clamped(column: u32, x: f32) -> f32 {
    var bounds: vec2<f32>;
    if column == LOG_SCALE {
        bounds = adam_uniforms.log_scales;
    } else if column == LOGIT {
        bounds = vec2<f32>(-adam_uniforms.logit_max, adam_uniforms.logit_max);
    } else if column == TAU {
        bounds = adam_uniforms.tau;
    } else if column == LOG_WIDTH {
        bounds = adam_uniforms.log_widths;
    } else {
        return x;
    }
    return select(clamp(x, bounds.x, bounds.y), x, is_nan(x));
}

// Learning rate of number `k` of a row in `column`.
fn rate_of(column: u32, k: u32) -> f32 {
    let at = select(column, SH_REST, column == SH && k >= 3u);
    return adam_uniforms.rates[at / 4u][at % 4u];
}

// Steps the quaternion at `to` along its gradient at `by`. Without a direction it becomes the identity.
fn step_quaternion(to: u32, by: u32, rate: f32, bias: vec2<f32>) {
    var q: vec4<f32>;
    for (var axis = 0u; axis < 4u; axis++) {
        q[axis] = updated(to + axis, d_parameters[by + axis], rate, bias);
    }
    if dot(q, q) < LENGTH_MIN * LENGTH_MIN {
        q = vec4<f32>(1.0, 0.0, 0.0, 0.0);
    }
    for (var axis = 0u; axis < 4u; axis++) {
        parameters[to + axis] = q[axis];
    }
}

// Steps the three log-scales at `to` along their gradient at `by` and the gradient of ab + bc + ca, for the standard
// deviations a, b, c.
fn step_scales(to: u32, by: u32, rate: f32, bias: vec2<f32>) {
    let scales = exp(vec3<f32>(parameters[to], parameters[to + 1u], parameters[to + 2u]));
    for (var axis = 0u; axis < 3u; axis++) {
        let others = scales[(axis + 1u) % 3u] + scales[(axis + 2u) % 3u];
        let g = d_parameters[by + axis] + adam_uniforms.fragment_weight * scales[axis] * others;
        parameters[to + axis] = clamped(LOG_SCALE, updated(to + axis, g, rate, bias));
    }
}

// Steps the motion at `to` along its gradient at `by`. `rate` is the rate of the centre; at the edge of the window, or of
// the clip, a step of any coefficient moves the Gaussian as far.
fn step_motion(to: u32, by: u32, log_width: f32, rate: f32, bias: vec2<f32>) {
    let reach = clamp(SUPPORT_RADIUS * exp(log_width), REACH_MIN, adam_uniforms.reach_max);
    var of_power = rate;
    for (var k = 0u; k < COUNT_MOTION; k++) {
        if k % 3u == 0u {
            of_power /= reach;
        }
        parameters[to + k] = updated(to + k, d_parameters[by + k], of_power, bias);
    }
}

// Steps a number of a drawn row, with the others that depend on it.
fn step_number(index: u32) {
    let i = index / NUMBERS;
    let row = order[i];
    let of_row = statistics[row];
    if of_row.is_usable == 0u {
        return;
    }
    let number = index % NUMBERS;
    var column = 0u;
    while column + 1u < COLUMNS && number >= START[column + 1u] {
        column++;
    }
    let k = number - START[column];
    let n = uniforms.gaussians;
    let to = place(n, START[column], COUNT[column], row) + k;
    let by = place(n, START[column], COUNT[column], i) + k;
    let bias = vec2<f32>(correction(LOG_BETA1, of_row.visits), correction(LOG_BETA2, of_row.visits));
    let is_of_time = column == TAU || column == LOG_WIDTH || column == MOTION || column == ROTATION_RATE;
    let rate = select(of_row.share, of_row.share_of_time, is_of_time) * rate_of(column, k);
    if column == MOTION {
        return; // Of the thread of the width: the rates depend on it.
    }
    if column == LOG_WIDTH {
        step_motion(
            place(n, START_MOTION, COUNT_MOTION, row),
            place(n, START_MOTION, COUNT_MOTION, i),
            parameters[to],
            of_row.share_of_time * rate_of(MOTION, 0u),
            bias,
        );
    }
    if column != ROTATION && column != LOG_SCALE {
        parameters[to] = clamped(column, updated(to, d_parameters[by], rate, bias));
    } else if k == 0u {
        // One thread takes all numbers, because the step of each depends on the others.
        if column == ROTATION {
            step_quaternion(to, by, rate, bias);
        } else {
            step_scales(to, by, rate, bias);
        }
    }
}

@compute @workgroup_size(GROUP)
fn adam(at: Invocation) {
    if totals[PAIRS] > uniforms.pair_capacity {
        return;
    }
    for (var index = thread(at); index < totals[DRAWN] * NUMBERS; index += at.groups.x * at.groups.y * GROUP) {
        step_number(index);
    }
}
