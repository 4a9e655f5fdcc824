// Rows of numbers whose length the device alone knows: what is scanned and sorted.

struct Series {
    // Which number of the state is the length, and how many there is room for: where there are more, none
    // are looked at.
    length_at: u32,
    capacity: u32,
    // Where in the state the sum goes.
    total_at: u32,
    // The lowest of the bits that are sorted by, or NO_DIGITS where what is scanned is the series itself.
    shift: u32,
}

@group(0) @binding(1) var<uniform> series: Series;
@group(0) @binding(3) var<storage, read_write> state: array<u32>;
// With digits: how many of each digit each chunk has, digit after digit.
@group(0) @binding(10) var<storage, read_write> counts: array<u32>;
@group(0) @binding(11) var<storage, read_write> block_sums: array<u32>;

fn length_of_series() -> u32 {
    let length = state[series.length_at];
    return select(length, 0u, length > series.capacity);
}

fn chunks() -> u32 {
    return (length_of_series() + CHUNK - 1u) / CHUNK;
}

// How many numbers are scanned.
fn scanned() -> u32 {
    if series.shift == NO_DIGITS {
        return length_of_series();
    }
    return DIGITS * chunks();
}
