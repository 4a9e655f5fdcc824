// Uniforms of a frame: the instant and the eyes (bind group 0).

struct Frame {
    // Normalised clip time as the sum of two f32: one is too coarse for the shortest windows.
    time: f32,
    time_rest: f32,
    // Limit of the support radius in standard deviations.
    radius_max: f32,
    // Depth from which on Gaussians are drawn whole, in units of the field; 0 if none fades.
    near: f32,
}

// A pinhole eye in OpenCV axes: x right, y down, z forward.
struct ViewUniform {
    // Rotation from the world's axes to the eye's.
    view_from_world: mat3x3<f32>,
    // Position of the eye relative to the clip's origin.
    eye: vec3<f32>,
    // Focal lengths, principal point and image size in pixels.
    focal: vec2<f32>,
    principal: vec2<f32>,
    size: vec2<f32>,
    // Range of x/z and y/z within which a footprint is computed.
    slope_min: vec2<f32>,
    slope_max: vec2<f32>,
    // Variance of the field's blur in px^2 of this view, at most FILTER: less in a view that is coarser than the
    // display.
    blur: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> views: array<ViewUniform, VIEWS>;
