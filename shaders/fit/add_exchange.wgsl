// Adding to a number that others add to at the same time, where the device exchanges integers alone.

// By row, SPLAT_NUMBERS each: the bits of floats.
@group(0) @binding(20) var<storage, read_write> d_splats: array<atomic<u32>>;

fn add(i: u32, value: f32) {
    var old = atomicLoad(&d_splats[i]);
    loop {
        let sum = bitcast<u32>(bitcast<f32>(old) + value);
        let result = atomicCompareExchangeWeak(&d_splats[i], old, sum);
        if result.exchanged {
            break;
        }
        old = result.old_value;
    }
}
