// What is the same for all Gaussians of a frame: the instant and the eyes.

struct Frame {
    // Normalised clip time.
    time: f32,
    // Farthest a splat reaches from its centre, in standard deviations.
    radius_max: f32,
}

// A pinhole eye in OpenCV axes: x right, y down, z forward.
struct View {
    view_from_world: mat4x4<f32>,
    // Position of the eye in the world.
    eye: vec3<f32>,
    // Focal lengths, principal point and image size in pixels.
    focal: vec2<f32>,
    principal: vec2<f32>,
    size: vec2<f32>,
    // Range of x/z and y/z within which a footprint is computed.
    slope_min: vec2<f32>,
    slope_max: vec2<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> views: array<View, VIEWS>;
