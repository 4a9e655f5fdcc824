// Prefix sums over the threads of a group of SUM_GROUP.

var<workgroup> sums: array<u32, SUM_GROUP>;

// Addition that saturates, so that an overflow is detected.
fn plus(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

// The sum of the numbers of the threads before this one; leaves the sum up to each thread in `sums` (Hillis and Steele).
fn sum_before(local: u32, number: u32) -> u32 {
    sums[local] = number;
    for (var stride = 1u; stride < SUM_GROUP; stride *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if local >= stride {
            before = sums[local - stride];
        }
        workgroupBarrier();
        sums[local] = plus(before, sums[local]);
    }
    workgroupBarrier();
    var before = 0u;
    if local > 0u {
        before = sums[local - 1u];
    }
    return before;
}
