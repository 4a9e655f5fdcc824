// Sorts keys and the rows that belong to them by one digit; equals keep their order. A thread takes a chunk
// of neighbours one after the other, so nothing waits for anything. Keys that are NOT_DRAWN are left out.

@group(0) @binding(6) var<storage, read> keys: array<u32>;
@group(0) @binding(7) var<storage, read> rows: array<u32>;
@group(0) @binding(8) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(9) var<storage, read_write> sorted_rows: array<u32>;

// A thread's own: of each digit how many there are, or where the next one goes.
var<workgroup> bins: array<u32, DIGITS * GROUP>;

fn bin_of(key: u32, local: u32) -> u32 {
    return ((key >> series.shift) % DIGITS) * GROUP + local;
}

@compute @workgroup_size(GROUP)
fn count_digits(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let chunk = thread(group, groups, local);
    let length = length_of_series();
    let stride = chunks();
    if chunk >= stride {
        return;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        bins[digit * GROUP + local] = 0u;
    }
    for (var i = chunk * CHUNK; i < min((chunk + 1u) * CHUNK, length); i++) {
        let key = keys[i];
        if key != NOT_DRAWN {
            bins[bin_of(key, local)] += 1u;
        }
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        counts[digit * stride + chunk] = bins[digit * GROUP + local];
    }
}

@compute @workgroup_size(GROUP)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let chunk = thread(group, groups, local);
    let length = length_of_series();
    let stride = chunks();
    if chunk >= stride {
        return;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        let i = digit * stride + chunk;
        bins[digit * GROUP + local] = counts[i] + block_sums[i / BLOCK];
    }
    for (var i = chunk * CHUNK; i < min((chunk + 1u) * CHUNK, length); i++) {
        let key = keys[i];
        if key != NOT_DRAWN {
            let bin = bin_of(key, local);
            let to = bins[bin];
            bins[bin] = to + 1u;
            sorted_keys[to] = key;
            sorted_rows[to] = rows[i];
        }
    }
}
