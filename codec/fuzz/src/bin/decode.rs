//! Fuzz target: decodes any bytes, as a clip and as a take. The results must be errors with offsets or valid clips,
//! and peak memory, counted at the allocator, within the limits.
#![no_main]

use codec_fuzz::{
    mutation::mutate,
    properties::{LIMITS, check_decoding, check_package},
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
    drop(decoded);

    ALLOCATOR.reset_peak_usage();
    check_package(bytes, |_, _| ());
    let peak = ALLOCATOR.peak_usage() - before;
    // The checks read each head once more.
    let allowed = LIMITS.max_bytes + 2 * (3 * bytes.len() + UNCOUNTED_BYTES);
    assert!(peak <= allowed, "{peak} bytes allocated at once for a take, {allowed} allowed");
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutate(data, size, max_size, seed)
});
