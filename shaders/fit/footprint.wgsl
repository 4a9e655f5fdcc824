// A splat at a pixel, as `rasterize` composites it and `rasterize_backward` differentiates it.

// By row.
@group(0) @binding(5) var<storage, read> splats: array<Splat>;
// The row of each pair's splat.
@group(0) @binding(26) var<storage, read> pair_rows: array<u32>;
// The pairs, tile by tile, front to back.
@group(0) @binding(27) var<storage, read> tile_pairs: array<u32>;
// Index of the first entry of each tile in `tile_pairs`, and the end of the last tile.
@group(0) @binding(13) var<storage, read> tile_starts: array<u32>;

struct Fragment {
    // Offset of the pixel from the splat's centre: x minus its mean at this y, and y.
    s: f32,
    dy: f32,
    // At most ALPHA_MAX.
    alpha: f32,
    // Alpha times transmittance: the weight of the splat's colour; 0 if the fragment is not drawn.
    weight: f32,
    // Whether the weight depends on the footprint: the fragment is drawn and its alpha is not clamped.
    has_gradient: bool,
    // Transmittance behind the fragment; 0 once the pixel is saturated.
    transmittance_behind: f32,
}

// The fragment of a splat at a pixel, behind others that left `transmittance`.
fn fragment(splat: Splat, pixel: vec2<u32>, transmittance: f32) -> Fragment {
    let d = (vec2<f32>(pixel) + vec2<f32>(0.5)) - splat.center;
    let s = d.x - splat.shear * d.y;
    let q = splat.inverse_variance.x * s * s + splat.inverse_variance.y * d.y * d.y;
    let unclamped = splat.opacity * exp(-0.5 * q);
    if !(unclamped >= ALPHA_MIN) {
        return Fragment(s, d.y, 0.0, 0.0, false, transmittance);
    }
    let alpha = min(unclamped, ALPHA_MAX);
    let behind = transmittance * (1.0 - alpha);
    // A pixel is saturated before the fragment that would lower its transmittance to this.
    if !(behind > TRANSMITTANCE_MIN) {
        return Fragment(s, d.y, alpha, 0.0, false, 0.0);
    }
    return Fragment(s, d.y, alpha, alpha * transmittance, unclamped <= ALPHA_MAX, behind);
}
