// Stage count: instead of drawing, counts the fragments of every instance.

@group(2) @binding(0) var<storage, read_write> counts: array<atomic<u32>>;

fn carried(instance: u32, color: vec3<f32>, opacity: f32) -> vec2<u32> {
    return vec2<u32>(instance, 0u);
}

@fragment
fn fragment(splat: Splat) {
    atomicAdd(&counts[splat.carried.x], 1u);
}
