// Stage splat, fragments: evaluates alpha at a pixel.
//
// Inputs: the offset from the centre in standard deviations, the colour and the opacity. Output:
// premultiplied colour, blended over the target.

// Red, green, blue and opacity as 16-bit floats.
fn carried(place: u32, color: vec3<f32>, opacity: f32) -> vec2<u32> {
    // The largest finite f16: brighter colours would become infinite.
    let finite = clamp(color, vec3<f32>(0.0), vec3<f32>(65504.0));
    return vec2<u32>(pack2x16float(finite.rg), pack2x16float(vec2<f32>(finite.b, opacity)));
}

@fragment
fn fragment(splat: Splat) -> @location(0) vec4<f32> {
    let square = dot(splat.local, splat.local);
    let blue_opacity = unpack2x16float(splat.carried.y);
    let alpha = min(ALPHA_MAX, blue_opacity.y * exp(-0.5 * square));
    if alpha < ALPHA_MIN || square > frame.radius_max * frame.radius_max {
        discard;
    }
    let color = vec3<f32>(unpack2x16float(splat.carried.x), blue_opacity.x);
    return vec4<f32>(color * alpha, alpha);
}
