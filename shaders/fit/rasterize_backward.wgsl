// Stage rasterize_backward: from the gradient by the pixels to that by the splats.
//
// A pixel is drawn again, front to back. Of its colours times their gradients, what is behind a fragment is
// what is left of the sum; nothing has to be divided by a transmittance, which can be tiny. A splat's sums
// are of the gradient by the exponent of its footprint, `-q / 2`, times powers of the place, and of that by
// its colour; `project_backward` makes of them what they stand for.

@group(0) @binding(14) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read> d_picture: array<vec4<f32>>;

@compute @workgroup_size(TILE, TILE)
fn rasterize_backward(@builtin(workgroup_id) tile: vec3<u32>, @builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= step.size) {
        return;
    }
    let index = tile.y * step.tiles.x + tile.x;
    let end = tile_starts[index + 1u];
    let place = pixel.y * step.size.x + pixel.x;
    let d_pixel = d_picture[place];
    var rest = dot(picture[place], d_pixel);
    var transmittance = 1.0;
    for (var i = tile_starts[index]; i < end && transmittance > 0.0; i++) {
        let row = pair_rows[i];
        let splat = splats[row];
        let drawn = fragment(splat, pixel.xy, transmittance);
        if drawn.weight > 0.0 {
            let gain = dot(splat.color, d_pixel.xyz) + d_pixel.w;
            rest -= drawn.weight * gain;
            let to = row * SPLAT_NUMBERS;
            if drawn.is_free {
                let by_alpha = transmittance * gain - rest / (1.0 - drawn.alpha);
                let e = by_alpha * drawn.alpha;
                add(to, e);
                add(to + 1u, e * drawn.s);
                add(to + 2u, e * drawn.dy);
                add(to + 3u, e * drawn.s * drawn.s);
                add(to + 4u, e * drawn.s * drawn.dy);
                add(to + 5u, e * drawn.dy * drawn.dy);
            }
            add(to + 6u, drawn.weight * d_pixel.x);
            add(to + 7u, drawn.weight * d_pixel.y);
            add(to + 8u, drawn.weight * d_pixel.z);
        }
        transmittance = drawn.transmittance_behind;
    }
}
