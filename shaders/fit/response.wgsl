// How a camera shows the colours of the image, and the way back of a gradient. What it adds to a colour counts by alpha,
// because the image is premultiplied.

struct Response {
    // Rows give red, green and blue: three factors of the image's colours, and an addend.
    color: array<vec4<f32>, 3>,
    // v of the factor 1 + v r^2, where r is 1 in the corners.
    vignette: f32,
}

@group(0) @binding(28) var<uniform> response: Response;

// Numbers of the response: its colours by rows, and the vignette.
const RESPONSE_NUMBERS: u32 = 13u;

// Square of the distance of a pixel from the centre of the image, 1 in the corners.
fn square_of(pixel: vec2<u32>) -> f32 {
    let size = vec2<f32>(uniforms.size);
    let at = vec2<f32>(pixel) - 0.5 * (size - 1.0);
    return 4.0 * dot(at, at) / dot(size, size);
}

fn factor_at(pixel: vec2<u32>) -> f32 {
    return 1.0 + square_of(pixel) * response.vignette;
}

// Without the vignette.
fn color_of(pixel: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(response.color[0], pixel),
        dot(response.color[1], pixel),
        dot(response.color[2], pixel),
    );
}

// From the gradient with respect to what the camera shows, without the vignette, to the gradient with respect to the image.
fn color_backward(d_color: vec3<f32>) -> vec4<f32> {
    return d_color.x * response.color[0] + d_color.y * response.color[1] + d_color.z * response.color[2];
}
