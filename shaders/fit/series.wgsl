// The input of scan and sort: a series whose length only the device knows.

struct Series {
    // Index of its length in the totals, and its capacity: a longer series counts as empty.
    length_at: u32,
    capacity: u32,
    // Index in the totals that receives the sum.
    total_at: u32,
    // Lowest bit of the digit that is sorted by, or NO_DIGITS to scan the series itself.
    shift: u32,
}

@group(0) @binding(1) var<uniform> series: Series;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
// The numbers to scan. For a sort: the number of keys with each digit in each chunk, `[digit][chunk]`.
@group(0) @binding(10) var<storage, read_write> counts: array<u32>;
@group(0) @binding(11) var<storage, read_write> block_sums: array<u32>;

fn length_of_series() -> u32 {
    let length = totals[series.length_at];
    return select(length, 0u, length > series.capacity);
}

fn chunks() -> u32 {
    return (length_of_series() + CHUNK - 1u) / CHUNK;
}

// Number of numbers to scan.
fn scan_length() -> u32 {
    if series.shift == NO_DIGITS {
        return length_of_series();
    }
    return DIGITS * chunks();
}
