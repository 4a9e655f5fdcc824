// Stage scan: exclusive prefix sums, in two levels. After both kernels, the sum of all numbers before the
// i-th is `counts[i] + block_sums[i / BLOCK]`.
//
// scan_blocks: sums within blocks, one thread per block. scan_totals: sums of the blocks, one group.
// The total goes to the totals.

var<workgroup> parts: array<u32, SCAN_GROUP>;

// Addition that saturates, so that an overflow is detected.
fn plus(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

@compute @workgroup_size(GROUP)
fn scan_blocks(at: Invocation) {
    let block = thread(at);
    let length = scan_length();
    let first = block * BLOCK;
    if first >= length {
        return;
    }
    var sum = 0u;
    for (var i = first; i < min(first + BLOCK, length); i++) {
        let count = counts[i];
        counts[i] = sum;
        sum = plus(sum, count);
    }
    block_sums[block] = sum;
}

@compute @workgroup_size(SCAN_GROUP)
fn scan_totals(@builtin(local_invocation_index) local: u32) {
    let blocks = (scan_length() + BLOCK - 1u) / BLOCK;
    let each = (blocks + SCAN_GROUP - 1u) / SCAN_GROUP;
    let first = min(local * each, blocks);
    let last = min(first + each, blocks);
    var sum = 0u;
    for (var i = first; i < last; i++) {
        sum = plus(sum, block_sums[i]);
    }
    parts[local] = sum;
    // Inclusive prefix sums over the threads (Hillis and Steele).
    for (var stride = 1u; stride < SCAN_GROUP; stride *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if local >= stride {
            before = parts[local - stride];
        }
        workgroupBarrier();
        parts[local] = plus(before, parts[local]);
    }
    workgroupBarrier();
    var offset = 0u;
    if local > 0u {
        offset = parts[local - 1u];
    }
    for (var i = first; i < last; i++) {
        let count = block_sums[i];
        block_sums[i] = offset;
        offset = plus(offset, count);
    }
    if local == SCAN_GROUP - 1u {
        totals[series.total_at] = parts[local];
    }
}
