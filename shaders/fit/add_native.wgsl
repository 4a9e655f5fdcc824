// Adding to a number that others add to at the same time, where the device adds floats by itself.

// By row, SPLAT_NUMBERS each.
@group(0) @binding(20) var<storage, read_write> d_splats: array<atomic<f32>>;

fn add(i: u32, value: f32) {
    atomicAdd(&d_splats[i], value);
}
