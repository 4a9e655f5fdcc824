// Filter without compensation: a footprint of any size keeps the Gaussian's opacity. Only the opacity is used.

fn filtered_opacity(opacity: f32, area: f32, trace: f32, sigma: vec2<f32>, blur: f32) -> f32 {
    return opacity;
}
