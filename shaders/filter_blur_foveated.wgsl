// Filter of a field that is fitted with blur, in frames that may be foveated. In a view that is coarser than the display
// the field's blur is less than FILTER, and the rest only adapts the footprint to larger pixels: opacity falls by as much
// as it enlarges the footprint.
//
// Inputs: the opacity, the root of the determinant of the footprint without filter, its trace, the standard deviations
// with the filter, and the variance of the blur. Output: the opacity to draw.

fn filtered_opacity(opacity: f32, area: f32, trace: f32, sigma: vec2<f32>, blur: f32) -> f32 {
    // Divided first: squares of areas would overflow.
    let kept = (area / sigma.x) * (area / sigma.x) + blur * ((trace + blur) / (sigma.x * sigma.x));
    let adapted = opacity * min(1.0, sqrt(max(0.0, kept)) / sigma.y);
    // Not a branch: for one, Mesa's software driver before version 25 keeps memory in every frame.
    return select(opacity, adapted, blur < FILTER);
}
