//! Fuzz target: decodes any bytes. The result must be an error with an offset or a valid clip, and peak
//! memory, counted at the allocator, within the limits.
#![no_main]

use codec_fuzz::{
    mutation::mutate,
    properties::{LIMITS, check_decoding},
};
use libfuzzer_sys::{fuzz_mutator, fuzz_target};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that [`LIMITS`] does not count: the head, an error, the state of a coder.
const UNCOUNTED_BYTES: usize = 16 << 10;

fuzz_target!(|bytes: &[u8]| {
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let decoded = codec::decode(bytes, &LIMITS);
    let peak = ALLOCATOR.peak_usage() - before;
    // The section table in memory is up to three times its bytes.
    let allowed = LIMITS.max_bytes + 3 * bytes.len() + UNCOUNTED_BYTES;
    assert!(peak <= allowed, "{peak} bytes allocated at once, {allowed} allowed");
    check_decoding(bytes, &decoded);
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutate(data, size, max_size, seed)
});
