// Filter without compensation: a footprint of any size keeps the Gaussian's opacity.

fn filtered_opacity(opacity: f32, area: f32, sigma: vec2<f32>) -> f32 {
    return opacity;
}
