// The mip filter of Mip-Splatting: opacity falls by as much as the filter enlarges the footprint.
//
// Inputs: the opacity, the root of the determinant of the footprint without filter, its trace (not used), the standard
// deviations with the filter, and the variance of a blur (not used). Output: the opacity to draw.

fn filtered_opacity(opacity: f32, area: f32, trace: f32, sigma: vec2<f32>, blur: f32) -> f32 {
    // Both deviations are roots of positive numbers; rounding may exceed 1.
    return opacity * min(1.0, area / sigma.x / sigma.y);
}
