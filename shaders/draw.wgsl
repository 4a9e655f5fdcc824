// Stage splat, fragments: evaluates alpha at a pixel.
//
// Inputs: the offset from the centre in standard deviations, the colour and the opacity. Output:
// premultiplied colour, blended over the target. `real` is f32 or f16, see `Purpose`.

// Red, green, blue and opacity as 16-bit floats.
fn carried(place: u32, color: vec3<f32>, opacity: f32) -> vec2<u32> {
    // Each Gaussian's colour is clamped: what layers in front weaken is then the same on targets of every depth.
    let shown = clamp(color, vec3<f32>(0.0), vec3<f32>(1.0));
    return vec2<u32>(pack2x16float(shown.rg), pack2x16float(vec2<f32>(shown.b, opacity)));
}

@fragment
fn fragment(splat: Splat) -> @location(0) vec4<f32> {
    // In f16, rounding the offset, its square and the exponent costs up to 0.5 % of alpha, where alpha is least.
    let offset = vec2<real>(splat.local);
    let square = dot(offset, offset);
    let blue_opacity = vec2<real>(unpack2x16float(splat.carried.y));
    let alpha = min(real(ALPHA_MAX), blue_opacity.y * exp(-0.5 * square));
    if alpha < real(ALPHA_MIN) || square > real(frame.radius_max * frame.radius_max) {
        discard;
    }
    let color = vec3<real>(vec2<real>(unpack2x16float(splat.carried.x)), blue_opacity.x);
    return vec4<f32>(vec4<real>(color * alpha, alpha));
}
