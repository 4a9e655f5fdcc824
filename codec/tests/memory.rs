//! Peak memory of decoding, honest and hostile. The counter sees the whole process, so this file
//! is one test; zstd's own state, about 100 KB of C memory, is not seen by it.

mod common;

use std::num::NonZero;

use codec::{Clip, Coder, EncodeOptions, Error, Field, Limits, Source, decode, decode_parallel, encode};
use common::{Parts, Shape, field, info, static_field};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Most bytes allocated at a time by `work` beyond those allocated before.
fn peak_of<T>(work: impl FnOnce() -> T) -> (T, usize) {
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let result = work();
    (result, ALLOCATOR.peak_usage() - before)
}

fn bytes_of(field: &Field) -> usize {
    let temporal = field.temporal.as_ref().map_or(0, |t| {
        4 * (t.tau.len() + t.s.len())
            + 12 * t.motion.len()
            + 16 * t.rotation_rates.as_ref().map_or(0, Vec::len)
    });
    field.len() * (12 + 16 + 12 + 4) + 12 * field.sh.len() + temporal
}

/// Most memory that decoding 45,000 Gaussians takes on up to four threads, relative to the clip.
const MOST: f64 = 1.5;

/// The head and what threads cost: not counted against the limits.
const SMALL: usize = 64 << 10;

#[test]
fn memory_is_bounded() {
    let info = info();
    for (coder, sh_degree) in [(Coder::Fixed, 0), (Coder::Fixed, 3), (Coder::Context, 0), (Coder::Context, 3)]
    {
        let field = field(Shape { sh_degree, ..Shape::full(40_000) }, 1);
        let plate = static_field(5_000, sh_degree, 2);
        let options = EncodeOptions { coder, layers: vec![5_000, 20_000], ..EncodeOptions::default() };
        let package = encode(&Source { info: &info, field: &field, plate: Some(&plate) }, &options).unwrap();
        for threads in [1, 4] {
            let threads = NonZero::new(threads).unwrap();
            let (clip, peak): (Clip, _) =
                peak_of(|| decode_parallel(&package, &Limits::default(), threads).unwrap());
            let decoded = bytes_of(&clip.static_field)
                + bytes_of(&clip.dynamic_field)
                + bytes_of(clip.plate.as_ref().unwrap());
            let ratio = peak as f64 / decoded as f64;
            println!(
                "{coder:?}, SH {sh_degree}, {threads} threads: {decoded} bytes decoded, peak {ratio:.3}"
            );
            assert!(ratio >= 1.0, "the counter does not count");
            assert!(ratio <= MOST, "peak is {ratio} times the decoded size");
            // The work space counts in full, whatever the chunks make of it.
            let limits = Limits { max_bytes: peak, ..Limits::default() };
            let (_, peak) = peak_of(|| decode_parallel(&package, &limits, threads));
            assert!(peak <= limits.max_bytes + SMALL, "peak {peak} of {limits:?}");
        }
    }

    // A bomb: 200,000 equal Gaussians, of which little is left after compression.
    let mut bomb = static_field(1, 0, 3);
    bomb = bomb.select(&vec![0; 200_000]);
    let package =
        encode(&Source { info: &info, field: &bomb, plate: None }, &EncodeOptions::default()).unwrap();
    assert!(package.len() < 20_000, "{} bytes are no bomb", package.len());
    let limits = Limits { max_bytes: 1 << 20, ..Limits::default() };
    let (result, peak) = peak_of(|| decode(&package, &limits));
    assert!(matches!(result, Err(Error::Limits { .. })), "{result:?}");
    assert!(peak <= limits.max_bytes + 3 * package.len(), "peak {peak}");

    // A payload that expands to far more than the table says.
    let mut parts = Parts::of(&package);
    parts.set_raw(0, &vec![0; 1 << 28]);
    let package = parts.join();
    let (result, peak) = peak_of(|| decode(&package, &Limits::default()));
    assert!(matches!(result, Err(Error::Format { .. })), "{result:?}");
    assert!(peak <= 16 << 20, "peak {peak}");

    // Counts that ask for everything, in a file of a few hundred bytes.
    let small = encode(
        &Source { info: &info, field: &static_field(3, 0, 4), plate: None },
        &EncodeOptions::default(),
    )
    .unwrap();
    let mut parts = Parts::of(&small);
    common::put_u32(&mut parts.head, 76, 4_000_000);
    let (result, peak) = peak_of(|| decode(&parts.join(), &Limits::default()));
    assert!(result.is_err());
    assert!(peak <= 1 << 16, "peak {peak}");
}
