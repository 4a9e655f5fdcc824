// A splat at a pixel: what `rasterize` composites, and `rasterize_backward` again.

// By row.
@group(0) @binding(5) var<storage, read> splats: array<Splat>;
// By pair, the row of its splat.
@group(0) @binding(26) var<storage, read> pair_rows: array<u32>;
// Of each tile, its pairs, front to back.
@group(0) @binding(27) var<storage, read> tile_pairs: array<u32>;
// Where the pairs of each tile begin, and where the last ones end.
@group(0) @binding(13) var<storage, read> tile_starts: array<u32>;

struct Fragment {
    // From the splat's centre to the pixel's: in x from the ellipse's middle, and in y.
    s: f32,
    dy: f32,
    // Opacity, at most ALPHA_MAX.
    alpha: f32,
    // Part of the splat's colour that reaches the eye; 0 where the splat is not drawn.
    weight: f32,
    // Whether the weight follows the footprint: the splat is drawn and alpha is below its bound.
    is_free: bool,
    // Part of the light from behind that passes this and everything in front; 0 once the pixel is finished.
    transmittance_behind: f32,
}

// The splat at a pixel that light of the given transmittance has come to.
fn fragment(splat: Splat, pixel: vec2<u32>, transmittance: f32) -> Fragment {
    let d = (vec2<f32>(pixel) + vec2<f32>(0.5)) - splat.center;
    let s = d.x - splat.lean * d.y;
    let full = splat.opacity * exp(-0.5 * (splat.inverse.x * s * s + splat.inverse.y * d.y * d.y));
    if !(full >= ALPHA_MIN) {
        return Fragment(s, d.y, 0.0, 0.0, false, transmittance);
    }
    let alpha = min(full, ALPHA_MAX);
    let behind = transmittance * (1.0 - alpha);
    // A pixel is finished before the fragment that would bring its transmittance down to this.
    if !(behind > TRANSMITTANCE_MIN) {
        return Fragment(s, d.y, alpha, 0.0, false, 0.0);
    }
    return Fragment(s, d.y, alpha, alpha * transmittance, full <= ALPHA_MAX, behind);
}
