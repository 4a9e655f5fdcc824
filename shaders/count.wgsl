// Stage count: counts the fragments of every quad instead of drawing.
//
// Output: `counts`, one entry per position in the draw order, summed over eyes.

@group(2) @binding(0) var<storage, read_write> counts: array<atomic<u32>>;

fn carried(place: u32, color: vec3<f32>, opacity: f32) -> vec2<u32> {
    return vec2<u32>(place, 0u);
}

@fragment
fn fragment(splat: Splat) {
    atomicAdd(&counts[splat.carried.x], 1u);
}
