//! Fuzz target: reads any bytes as the section of sound of a package. The results must be errors with offsets in the
//! section or sounds that are written as the same bytes, and peak memory, counted at the allocator, within the limits.
#![no_main]

use std::sync::LazyLock;

use codec_fuzz::properties::{LIMITS, check_sound};
use codec_fuzz::sound::SoundlessPackage;
use libfuzzer_sys::fuzz_target;
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that the length of a section does not bound: an error.
const UNCOUNTED_BYTES: usize = 4 << 10;

static PACKAGE: LazyLock<SoundlessPackage> = LazyLock::new(SoundlessPackage::small);

fuzz_target!(|payload: &[u8]| {
    let package = PACKAGE.with(payload);
    let head = codec::contents(&package, &LIMITS).expect("the head is valid whatever the section is");
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    drop(head.sound(&package, &LIMITS));
    let peak = ALLOCATOR.peak_usage() - before;
    // The packets once more, and four bytes for the end of each, which has at least three.
    let allowed = LIMITS.max_bytes.min(3 * payload.len()) + UNCOUNTED_BYTES;
    assert!(peak <= allowed, "{peak} bytes allocated at once, {allowed} allowed");
    check_sound(&package, &head);
});
