// Stage adam: a step along the gradient of those Gaussians that the picture shows (Kingma and Ba, "Adam",
// 2015), within the bounds. A thread moves one number, or a quaternion.
//
// Bias is corrected by how often a row was visited itself, not by the number of steps.

struct AdamUniforms {
    // Step lengths of the columns; those of motion are three, one a power, and of the spherical harmonics
    // after the first the last.
    rates: array<vec4<f32>, 3>,
    // Least and greatest log-scale, log-width and tau, and the greatest logit.
    log_scales: vec2<f32>,
    log_widths: vec2<f32>,
    tau: vec2<f32>,
    logit_max: f32,
}

@group(0) @binding(2) var<uniform> pace: AdamUniforms;
@group(0) @binding(3) var<storage, read> state: array<u32>;
@group(0) @binding(4) var<storage, read_write> parameters: array<f32>;
@group(0) @binding(12) var<storage, read> order: array<u32>;
@group(0) @binding(21) var<storage, read> d_parameters: array<f32>;
@group(0) @binding(22) var<storage, read> memory: array<Memory>;
@group(0) @binding(23) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(24) var<storage, read_write> second_moments: array<f32>;

// 1 / (1 - beta^visits), given the logarithm of beta.
fn correction(log_beta: f32, visits: u32) -> f32 {
    let x = log_beta * f32(visits);
    if x < -0.5 {
        return 1.0 / (1.0 - exp(x));
    }
    // 1 - e^x near 0 by its series: the term left out is below 2^-24.
    var sum = 1.0;
    for (var k = 8.0; k > 1.0; k -= 1.0) {
        sum = 1.0 + sum * x / k;
    }
    return -1.0 / (x * sum);
}

// Where the step of a number leads.
fn moved(at: u32, g: f32, rate: f32, bias: vec2<f32>) -> f32 {
    let first = BETA1 * first_moments[at] + (1.0 - BETA1) * g;
    let second = BETA2 * second_moments[at] + (1.0 - BETA2) * g * g;
    first_moments[at] = first;
    second_moments[at] = second;
    return parameters[at] - rate * (first * bias.x) / (sqrt(second * bias.y) + EPSILON);
}

// What is not a number stays so.
fn within(x: f32, bounds: vec2<f32>) -> f32 {
    return select(clamp(x, bounds.x, bounds.y), x, is_nan(x));
}

fn rate_of(column: u32, k: u32) -> f32 {
    var at = column;
    if column == SH && k >= 3u {
        at = SH_REST;
    } else if column == MOTION {
        at = column + k / 3u;
    } else if column == ROTATION_RATE {
        at = ROTATION_RATE_AT;
    }
    return pace.rates[at / 4u][at % 4u];
}

@compute @workgroup_size(GROUP)
fn adam(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let index = thread(group, groups, local);
    let i = index / NUMBERS;
    if i >= state[DRAWN] || state[PAIRS] > step.pair_capacity {
        return;
    }
    let row = order[i];
    let remembered = memory[row];
    if remembered.is_usable == 0u {
        return;
    }
    let number = index % NUMBERS;
    var column = 0u;
    while column + 1u < COLUMNS && number >= START[column + 1u] {
        column++;
    }
    let k = number - START[column];
    let n = step.gaussians;
    let to = place(n, START[column], COUNT[column], row) + k;
    let by = place(n, START[column], COUNT[column], i) + k;
    let bias = vec2<f32>(correction(LOG_BETA1, remembered.visits), correction(LOG_BETA2, remembered.visits));
    let rate = rate_of(column, k);

    if column == ROTATION {
        // Whether a quaternion still has a direction is known of all of it.
        if k > 0u {
            return;
        }
        var q: vec4<f32>;
        for (var axis = 0u; axis < 4u; axis++) {
            q[axis] = moved(to + axis, d_parameters[by + axis], rate, bias);
        }
        if dot(q, q) < LENGTH_MIN * LENGTH_MIN {
            q = vec4<f32>(1.0, 0.0, 0.0, 0.0);
        }
        for (var axis = 0u; axis < 4u; axis++) {
            parameters[to + axis] = q[axis];
        }
        return;
    }
    var value = moved(to, d_parameters[by], rate, bias);
    if column == LOG_SCALE {
        value = within(value, pace.log_scales);
    } else if column == LOGIT {
        value = within(value, vec2<f32>(-pace.logit_max, pace.logit_max));
    } else if column == TAU {
        value = within(value, pace.tau);
    } else if column == LOG_WIDTH {
        value = within(value, pace.log_widths);
    }
    parameters[to] = value;
}
