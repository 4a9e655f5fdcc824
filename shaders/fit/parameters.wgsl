// Read access to the parameters of a Gaussian, by row.

@group(0) @binding(4) var<storage, read> parameters: array<f32>;

fn vector_at(i: u32) -> vec3<f32> {
    return vec3<f32>(parameters[i], parameters[i + 1u], parameters[i + 2u]);
}

fn quaternion_at(i: u32) -> vec4<f32> {
    return vec4<f32>(vector_at(i), parameters[i + 3u]);
}

// A parameter of a column with one float per row.
fn scalar_of(row: u32, start: u32) -> f32 {
    return parameters[place(uniforms.gaussians, start, 1u, row)];
}

fn center_of(row: u32) -> vec3<f32> {
    return vector_at(place(uniforms.gaussians, START_CENTER, COUNT_CENTER, row));
}

fn log_scale_of(row: u32) -> vec3<f32> {
    return vector_at(place(uniforms.gaussians, START_LOG_SCALE, COUNT_LOG_SCALE, row));
}

// w, x, y, z.
fn rotation_of(row: u32) -> vec4<f32> {
    return quaternion_at(place(uniforms.gaussians, START_ROTATION, COUNT_ROTATION, row));
}

fn rotation_rate_of(row: u32) -> vec4<f32> {
    return quaternion_at(place(uniforms.gaussians, START_ROTATION_RATE, COUNT_ROTATION_RATE, row));
}

// Coefficient of harmonic `k`.
fn harmonic_of(row: u32, k: u32) -> vec3<f32> {
    return vector_at(place(uniforms.gaussians, START_SH, COUNT_SH, row) + 3u * k);
}

// Coefficient of the power `k + 1` of time.
fn motion_of(row: u32, k: u32) -> vec3<f32> {
    return vector_at(place(uniforms.gaussians, START_MOTION, COUNT_MOTION, row) + 3u * k);
}
