// A Gaussian projected into the image. With `d` from its centre to a pixel's centre, the squared
// Mahalanobis distance is `q = inverse_variance.x (d.x - shear d.y)^2 + inverse_variance.y d.y^2`.

struct Splat {
    // In pixels, from the image's top left corner.
    center: vec2<f32>,
    // In px^-2: of x given y, and of y.
    inverse_variance: vec2<f32>,
    // Half the size of the bounding box of the ellipse `q = q_max`.
    half_extent: vec2<f32>,
    // Mean of d.x per unit of d.y.
    shear: f32,
    // `q` above which alpha is certainly below ALPHA_MIN.
    q_max: f32,
    // Red, green, blue towards the camera, at least 0.
    color: vec3<f32>,
    // Opacity at the frame, compensated if the filter compensates, at least ALPHA_MIN.
    opacity: f32,
    // `d.y` at which the ellipse touches its bounding box on the right; on the left it is -tangent_y.
    tangent_y: f32,
    // Number of tiles that it overlaps, and the index of its first splat-tile pair.
    tiles: u32,
    first_pair: u32,
}
