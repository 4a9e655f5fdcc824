// A Gaussian as the rasteriser sees it. With `d` from its centre to a pixel's, the squared distance in
// standard deviations is `q = inverse.x (d.x - lean d.y)^2 + inverse.y d.y^2`.

struct Splat {
    // In pixels, from the image's top left corner.
    center: vec2<f32>,
    // Inverse variances in px^-2: of x where y is known, and of y.
    inverse: vec2<f32>,
    // Half the size of the box around the ellipse `q = far`.
    reach: vec2<f32>,
    // How far the ellipse's middle moves in x per step in y.
    lean: f32,
    // `q` from which alpha is certainly below ALPHA_MIN.
    far: f32,
    // Red, green, blue towards the eye, from 0 up.
    color: vec3<f32>,
    // Opacity at the instant, from ALPHA_MIN up.
    opacity: f32,
    // `d.y` where the ellipse touches its box on the right; the negative of it on the left.
    touch: f32,
    // Number of tiles that it reaches, and the first of its pairs with them.
    tiles: u32,
    first_pair: u32,
}
