// Stage sort: one pass of a stable radix sort of keys with their values. Keys that are NOT_DRAWN are dropped.
//
// The groups take equal parts of the series, in order, and a thread of each group has a digit of its own. count_digits: the
// keys of a part by digit. scatter: moves the keys of a part behind those of the parts before, SUM_GROUP neighbours at a
// time. A key's place among neighbours with its digit is the number of bits before its own in the mask of the digit, so
// no order depends on which thread is first.

// A series whose length only the device knows.
struct Series {
    // Index of its length in the totals, and its capacity: a longer series counts as empty.
    length_at: u32,
    capacity: u32,
    // Index in the totals that receives the number of keys that are not dropped.
    total_at: u32,
    // Lowest bit of the digit that is sorted by.
    shift: u32,
}

// A part of the series, from `start` up to, but not including, `end`.
struct Part {
    start: u32,
    end: u32,
}

@group(0) @binding(1) var<uniform> series: Series;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
@group(0) @binding(6) var<storage, read> keys: array<u32>;
@group(0) @binding(7) var<storage, read> rows: array<u32>;
@group(0) @binding(8) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(9) var<storage, read_write> sorted_rows: array<u32>;
// Number of keys with each digit in each part, `[part][digit]`.
@group(0) @binding(10) var<storage, read_write> counts: array<u32>;

// Words of a mask with a bit for each thread.
const WORDS: u32 = SUM_GROUP / 32u;

var<workgroup> part: Part;
var<workgroup> digit_counts: array<atomic<u32>, DIGITS>;
// The destination of the next key with each digit.
var<workgroup> next: array<u32, DIGITS>;
// The threads whose key has each digit, a bit each.
var<workgroup> masks: array<atomic<u32>, DIGITS * WORDS>;

fn digit_of(key: u32) -> u32 {
    return (key >> series.shift) % DIGITS;
}

// The part of a group; the same for all its threads.
fn part_of(at: Invocation) -> Part {
    if at.local == 0u {
        var length = totals[series.length_at];
        if length > series.capacity {
            length = 0u;
        }
        let turns = (length + SUM_GROUP - 1u) / SUM_GROUP;
        let each = (turns + at.groups.x - 1u) / at.groups.x * SUM_GROUP;
        let start = min(at.group.x * each, length);
        part = Part(start, min(start + each, length));
    }
    return workgroupUniformLoad(&part);
}

@compute @workgroup_size(SUM_GROUP)
fn count_digits(at: Invocation) {
    atomicStore(&digit_counts[at.local], 0u);
    let mine = part_of(at);
    for (var i = mine.start + at.local; i < mine.end; i += SUM_GROUP) {
        if keys[i] != NOT_DRAWN {
            atomicAdd(&digit_counts[digit_of(keys[i])], 1u);
        }
    }
    workgroupBarrier();
    counts[at.group.x * DIGITS + at.local] = atomicLoad(&digit_counts[at.local]);
}

@compute @workgroup_size(SUM_GROUP)
fn scatter(at: Invocation) {
    let digit = at.local;
    var before = 0u;
    var all = 0u;
    for (var other = 0u; other < at.groups.x; other++) {
        let count = counts[other * DIGITS + digit];
        before += select(0u, count, other < at.group.x);
        all += count;
    }
    next[digit] = sum_before(at.local, all) + before;
    let mine = part_of(at);
    if at.group.x == 0u && at.local == SUM_GROUP - 1u {
        totals[series.total_at] = sums[at.local];
    }
    for (var turn = mine.start; turn < mine.end; turn += SUM_GROUP) {
        for (var word = 0u; word < WORDS; word++) {
            atomicStore(&masks[digit * WORDS + word], 0u);
        }
        workgroupBarrier();
        let i = turn + at.local;
        var key = NOT_DRAWN;
        if i < mine.end {
            key = keys[i];
        }
        let mask = digit_of(key) * WORDS;
        let word_of_thread = at.local / 32u;
        let bit = 1u << (at.local % 32u);
        if key != NOT_DRAWN {
            atomicOr(&masks[mask + word_of_thread], bit);
        }
        workgroupBarrier();
        if key != NOT_DRAWN {
            var to = next[digit_of(key)] + countOneBits(atomicLoad(&masks[mask + word_of_thread]) & (bit - 1u));
            for (var word = 0u; word < word_of_thread; word++) {
                to += countOneBits(atomicLoad(&masks[mask + word]));
            }
            sorted_keys[to] = key;
            sorted_rows[to] = rows[i];
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            next[digit] += countOneBits(atomicLoad(&masks[digit * WORDS + word]));
        }
    }
}
