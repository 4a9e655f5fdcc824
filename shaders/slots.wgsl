// The segments of a take, in place of the ranges of a clip (bind group 1).
//
// Every segment that is drawn has a slot: its numbers have ranges of their own, and it has a clip time of its own.
// Rows count through all segments. The vertex stage selects the slot of its row once; the other files then read
// `ranges` as they do in a clip.

struct Slot {
    ranges: Ranges,
    // Clip time of the segment as the sum of two f32, as in `Frame`.
    time: f32,
    time_rest: f32,
}

@group(1) @binding(0) var<uniform> slots: array<Slot, SLOTS>;

var<private> ranges: Ranges;
var<private> slot_time: f32;
var<private> slot_time_rest: f32;

// The row of an entry of the draw order, and the slot above its ROW_BITS bits, which this selects.
fn row_in_slot(entry: u32) -> u32 {
    let slot = slots[entry >> ROW_BITS];
    ranges = slot.ranges;
    slot_time = slot.time;
    slot_time_rest = slot.time_rest;
    return extractBits(entry, 0u, ROW_BITS);
}
