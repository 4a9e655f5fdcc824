// The gradient with respect to the view, of a Gaussian or of several.

struct ViewGradient {
    // With respect to a rotation vector, in camera axes, which turns the scene about the camera.
    rotation: vec3<f32>,
    time: f32,
    // With respect to the centre, in world axes.
    center: vec3<f32>,
    // With respect to the logarithm of the focal lengths.
    log_focal: f32,
}
