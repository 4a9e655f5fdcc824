// Stage foveate: composes the image of an eye from a coarse image of all of it, the wide image, and a sharp one of its
// middle, the inset.
//
// Inputs: both images, premultiplied, with one layer per eye. Output: the pixel of the composed image, premultiplied.
//
// Pixels of the inset coincide with pixels of the composed image. Near its edge it fades into the wide image, which is
// interpolated linearly. Both are blended in the values that splats are blended in, so that alpha equals either image's
// alpha where both agree.

struct Foveation {
    // Upper left corner of the inset in the composed image, in pixels.
    offset: vec2<f32>,
    // Size of both images in pixels: the corner of their textures that is drawn.
    size: vec2<f32>,
    // Pixels of the wide image per pixel of the composed one.
    wide_from_full: vec2<f32>,
    // Width in pixels of the edge in which the inset fades.
    feather: f32,
}

@group(0) @binding(0) var<uniform> foveation: array<Foveation, VIEWS>;
@group(0) @binding(1) var wide: texture_2d_array<f32>;
@group(0) @binding(2) var inset: texture_2d_array<f32>;
@group(0) @binding(3) var linear: sampler;

fn composed(pixel: vec2<f32>, eye: u32) -> vec4<f32> {
    let f = foveation[eye];
    let within = pixel - f.offset;
    let edge = min(within, f.size - within);
    let weight = smoothstep(0.0, f.feather, min(edge.x, edge.y));
    let last = vec2<i32>(f.size) - 1;
    let sharp = textureLoad(inset, clamp(vec2<i32>(floor(within)), vec2<i32>(0), last), eye, 0);
    // What was not drawn in this frame lies beyond the last pixel.
    let place = clamp(pixel * f.wide_from_full, vec2<f32>(0.5), f.size - 0.5);
    let coarse = textureSampleLevel(wide, linear, place / vec2<f32>(textureDimensions(wide)), eye, 0.0);
    return mix(coarse, sharp, weight);
}
