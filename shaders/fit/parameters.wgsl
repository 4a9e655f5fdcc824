// The columns of what is fitted, one after the other, each row after row. COUNT_* is how many numbers a
// row has in a column, START_* how many it has in those before.

@group(0) @binding(4) var<storage, read> parameters: array<f32>;

// Where the numbers of a row begin in a column of `rows` rows.
fn place(rows: u32, start: u32, count: u32, row: u32) -> u32 {
    return rows * start + row * count;
}

fn vector_at(i: u32) -> vec3<f32> {
    return vec3<f32>(parameters[i], parameters[i + 1u], parameters[i + 2u]);
}

fn quaternion_at(i: u32) -> vec4<f32> {
    return vec4<f32>(vector_at(i), parameters[i + 3u]);
}

fn number_of(row: u32, start: u32) -> f32 {
    return parameters[place(step.gaussians, start, 1u, row)];
}

fn center_of(row: u32) -> vec3<f32> {
    return vector_at(place(step.gaussians, START_CENTER, COUNT_CENTER, row));
}

fn log_scale_of(row: u32) -> vec3<f32> {
    return vector_at(place(step.gaussians, START_LOG_SCALE, COUNT_LOG_SCALE, row));
}

// w, x, y, z.
fn rotation_of(row: u32) -> vec4<f32> {
    return quaternion_at(place(step.gaussians, START_ROTATION, COUNT_ROTATION, row));
}

fn rotation_rate_of(row: u32) -> vec4<f32> {
    return quaternion_at(place(step.gaussians, START_ROTATION_RATE, COUNT_ROTATION_RATE, row));
}

fn harmonic_of(row: u32, k: u32) -> vec3<f32> {
    return vector_at(place(step.gaussians, START_SH, COUNT_SH, row) + 3u * k);
}

// Coefficient of the power `k + 1` of time.
fn motion_of(row: u32, k: u32) -> vec3<f32> {
    return vector_at(place(step.gaussians, START_MOTION, COUNT_MOTION, row) + 3u * k);
}
