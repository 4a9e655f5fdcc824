// Factor of the opacity of a Gaussian whose centre is `depth` in front of an eye: the rule of `near_fade` in Rust, shared
// by playing and fitting.

// 0 up to FADE_START of `near`, 1 from `near` on, linear between. Nothing at or behind the eye is drawn, nor NaN.
fn near_fade(depth: f32, near: f32) -> f32 {
    if !(depth > 0.0) {
        return 0.0;
    }
    if depth >= near {
        return 1.0;
    }
    return max((depth / near - FADE_START) / (1.0 - FADE_START), 0.0);
}
