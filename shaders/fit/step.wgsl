// What the stages of a fit share: the instant, the camera, the sizes.

struct StepUniforms {
    // Rows of the rigid transform: the rotation, and the translation in w.
    view_from_world: array<vec4<f32>, 3>,
    // Position of the eye in the world.
    eye: vec3<f32>,
    // Time in frames.
    frame: f32,
    // In pixels.
    focal: vec2<f32>,
    principal: vec2<f32>,
    // Least and largest x/z and y/z at which a footprint is computed.
    slope_min: vec2<f32>,
    slope_max: vec2<f32>,
    // Of the image, in pixels and in tiles.
    size: vec2<u32>,
    tiles: vec2<u32>,
    // Number of Gaussians.
    gaussians: u32,
    // Pairs of a splat and a tile for which there is room.
    pair_capacity: u32,
    // 1 where windows' centres move by opacity alone, else 0.
    is_detached: u32,
}

@group(0) @binding(0) var<uniform> step: StepUniforms;

// Told by the bits: compilers may take it that no number is infinite or NaN.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

fn are_finite(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}
