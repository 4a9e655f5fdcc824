// Stage rasterize: composites splats into pixels, front to back (the paper's rendering equation). One group
// per tile, one thread per pixel.
//
// In: splats, and the pairs of each tile front to back. Out: the image over black.

@group(0) @binding(14) var<storage, read_write> image: array<vec4<f32>>;

@compute @workgroup_size(TILE, TILE)
fn rasterize(@builtin(workgroup_id) tile: vec3<u32>, @builtin(global_invocation_id) pixel: vec3<u32>) {
    if any(pixel.xy >= uniforms.size) {
        return;
    }
    let index = tile.y * uniforms.tiles.x + tile.x;
    let end = tile_starts[index + 1u];
    var transmittance = 1.0;
    var sum = vec4<f32>(0.0);
    for (var i = tile_starts[index]; i < end && transmittance > 0.0; i++) {
        let splat = splats[pair_rows[tile_pairs[i]]];
        let drawn = fragment(splat, pixel.xy, transmittance);
        transmittance = drawn.transmittance_behind;
        sum += drawn.weight * vec4<f32>(splat.color, 1.0);
    }
    image[pixel.y * uniforms.size.x + pixel.x] = sum;
}
