// The uniforms of a step: time, camera, sizes.

struct StepUniforms {
    // Rows of the rigid transform: the rotation, and the translation in w.
    view_from_world: array<vec4<f32>, 3>,
    // Position of the camera in the world.
    eye: vec3<f32>,
    // Time in intervals.
    time: f32,
    // Focal lengths and principal point in pixels.
    focal: vec2<f32>,
    principal: vec2<f32>,
    // Lowest and highest x/z and y/z at which the Jacobian is evaluated.
    slope_min: vec2<f32>,
    slope_max: vec2<f32>,
    // Size of the image in pixels and in tiles.
    size: vec2<u32>,
    tiles: vec2<u32>,
    // Number of Gaussians.
    gaussians: u32,
    // Capacity of the buffers of splat-tile pairs.
    pair_capacity: u32,
    // 1 to stop the gradient of positions and rotations with respect to tau, else 0.
    detach_tau: u32,
    // Depth from which on Gaussians are drawn whole; 0 if none fades.
    near: f32,
    // Weight of alpha in the loss, against a channel of colour.
    alpha_channels: f32,
    // 1 if d_image has the gradient of another term, to which the gradient of the loss is added; else 0.
    adds_gradient: u32,
    // 1 to leave the gradient with respect to the camera, else 0.
    learns_camera: u32,
}

@group(0) @binding(0) var<uniform> uniforms: StepUniforms;

// These two test bits, because compilers may assume that no number is infinite or NaN.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

fn are_finite(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}
