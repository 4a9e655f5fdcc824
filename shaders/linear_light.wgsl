// Stage linear_light: premultiplies colours in linear light, as a headset's compositor blends them.
//
// Input: display-referred colour c premultiplied by alpha a, as splats and the panel blend it: a c. The compositor decodes
// an sRGB image before it blends, and decode(a c) is darker than a decode(c). Output: encode(a decode(c)), and alpha.

fn decoded(color: vec3<f32>) -> vec3<f32> {
    let high = pow((color + 0.055) / 1.055, vec3<f32>(2.4));
    return select(high, color / 12.92, color <= vec3<f32>(0.04045));
}

fn encoded(light: vec3<f32>) -> vec3<f32> {
    let high = 1.055 * pow(light, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(high, 12.92 * light, light <= vec3<f32>(0.0031308));
}

fn linear_light(color: vec4<f32>) -> vec4<f32> {
    // In 8 bits a c may round to more than a, and colours above 1 are not displayed. Where a is 0, so is a c.
    let straight = clamp(color.rgb / max(color.a, 1e-6), vec3<f32>(0.0), vec3<f32>(1.0));
    return vec4<f32>(encoded(color.a * decoded(straight)), color.a);
}
