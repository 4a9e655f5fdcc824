// Stage sort: one pass of a stable radix sort of keys with their values. A thread takes a chunk of
// neighbours in order, so no thread waits for another. Keys that are NOT_DRAWN are dropped.
//
// count_digits: keys per digit and chunk, which a scan turns into destinations. scatter: moves them there.
// The two loops over a chunk are apart because a kernel binds at most eight buffers.

@group(0) @binding(6) var<storage, read> keys: array<u32>;
@group(0) @binding(7) var<storage, read> rows: array<u32>;
@group(0) @binding(8) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(9) var<storage, read_write> sorted_rows: array<u32>;

// Per thread and digit: the number of keys so far, or the destination of the next.
var<workgroup> bins: array<u32, DIGITS * GROUP>;

fn bin_of(key: u32, local: u32) -> u32 {
    return ((key >> series.shift) % DIGITS) * GROUP + local;
}

@compute @workgroup_size(GROUP)
fn count_digits(at: Invocation) {
    let chunk = thread(at);
    let length = length_of_series();
    let stride = chunks();
    if chunk >= stride {
        return;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        bins[digit * GROUP + at.local] = 0u;
    }
    for (var i = chunk * CHUNK; i < min((chunk + 1u) * CHUNK, length); i++) {
        if keys[i] != NOT_DRAWN {
            bins[bin_of(keys[i], at.local)] += 1u;
        }
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        counts[digit * stride + chunk] = bins[digit * GROUP + at.local];
    }
}

@compute @workgroup_size(GROUP)
fn scatter(at: Invocation) {
    let chunk = thread(at);
    let length = length_of_series();
    let stride = chunks();
    if chunk >= stride {
        return;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        let i = digit * stride + chunk;
        bins[digit * GROUP + at.local] = counts[i] + block_sums[i / BLOCK];
    }
    for (var i = chunk * CHUNK; i < min((chunk + 1u) * CHUNK, length); i++) {
        let key = keys[i];
        if key != NOT_DRAWN {
            let bin = bin_of(key, at.local);
            let to = bins[bin];
            bins[bin] = to + 1u;
            sorted_keys[to] = key;
            sorted_rows[to] = rows[i];
        }
    }
}
