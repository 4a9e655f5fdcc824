// The sums of all numbers before each: within blocks, then of the blocks. Whoever reads them adds the two.

var<workgroup> parts: array<u32, SCAN_GROUP>;

// Stays at the largest number: a sum that is too large is then known to be.
fn plus(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

// Replaces each number by the sum of those before it in its block.
@compute @workgroup_size(GROUP)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = thread(group, groups, local);
    let length = scanned();
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

// Replaces the sum of each block by that of the blocks before it; the total goes to the state. One group.
@compute @workgroup_size(SCAN_GROUP)
fn scan_totals(@builtin(local_invocation_index) local: u32) {
    let blocks = (scanned() + BLOCK - 1u) / BLOCK;
    let each = (blocks + SCAN_GROUP - 1u) / SCAN_GROUP;
    let first = min(local * each, blocks);
    let last = min(first + each, blocks);
    var sum = 0u;
    for (var i = first; i < last; i++) {
        sum = plus(sum, block_sums[i]);
    }
    parts[local] = sum;
    for (var reach = 1u; reach < SCAN_GROUP; reach *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if local >= reach {
            before = parts[local - reach];
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
        state[series.total_at] = parts[local];
    }
}
