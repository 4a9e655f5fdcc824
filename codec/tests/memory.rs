//! Peak memory of decoding valid and hostile packages. The allocator counts the whole process, so this
//! file is one test; it does not count zstd's own state, about 100 KB of C memory.

mod common;

use std::num::NonZero;

use codec::{Clip, Coder, Error, Field, Limits, Take, decode, decode_parallel};
use common::{Parts, Shape, field, options, package, segment_package, static_field, take_package};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Runs `work`, and returns its result and its peak memory beyond the memory already allocated.
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

/// Largest peak memory of decoding 45,000 Gaussians on up to four threads, relative to the clip.
const RATIO_MAX: f64 = 1.5;

/// Memory that the limits do not count: the head and the threads.
const UNCOUNTED_BYTES: usize = 64 << 10;

/// The smallest limits that a package decodes in, to within 16 KiB.
fn smallest_limits(bytes: &[u8]) -> Limits {
    let limits = |kibibytes: usize| Limits { max_bytes: kibibytes << 10, ..Limits::default() };
    let (mut too_few, mut enough) = (0usize, 64 << 10);
    while enough - too_few > 16 {
        let midpoint = too_few.midpoint(enough);
        let decodes = decode(bytes, &limits(midpoint)).is_ok();
        *(if decodes { &mut enough } else { &mut too_few }) = midpoint;
    }
    limits(enough)
}

/// Segments of a take, decoded in more columns than they have.
fn memory_of_segments_is_bounded() {
    for coder in Coder::ALL {
        let few = Shape { sh_degree: 0, motion_order: 1, rotation_rates: false, ..Shape::full(20_000) };
        let segment = |field: &Field| segment_package(field, None, &options(coder, &[5_000]), 1.0);
        let (narrow, wide) = (segment(&field(few, 1)), segment(&field(Shape::full(200), 2)));
        let mut segments = vec![(0.0, 1.0, 0, narrow.clone())];
        segments.extend((1..2_000).map(|start| (f64::from(start), 1.0, 0, wide.clone())));
        let head = take_package(2_000.0, &segments);
        let (long, table) = peak_of(|| package_head(&head, &Limits::default()));
        assert!(table > 2_000 * 48, "{table} bytes of table");
        let short = package_head(&take_package(2.0, &segments[..2]), &Limits::default());
        for threads in [1, 4] {
            let threads = NonZero::new(threads).unwrap();
            let (clip, peak) =
                peak_of(|| short.decode_segment(0, &narrow, &Limits::default(), threads).unwrap());
            assert_eq!((clip.dynamic_field.sh_degree, clip.dynamic_field.motion_order()), (3, 3));
            let decoded = bytes_of(&clip.static_field) + bytes_of(&clip.dynamic_field);
            let ratio = peak as f64 / decoded as f64;
            println!("{coder:?}, a segment in more columns, {threads} threads: peak {ratio:.3}");
            assert!((1.0..=RATIO_MAX).contains(&ratio), "peak is {ratio} times the decoded size");
        }
        // The table counts towards the limits of a segment, and columns that it has not do too.
        let fits = |take: &Take, max_bytes: usize| {
            let limits = Limits { max_bytes, ..Limits::default() };
            let (result, peak) =
                peak_of(|| take.decode_segment(0, &narrow, &limits, NonZero::<usize>::MIN).is_ok());
            assert!(peak <= max_bytes + UNCOUNTED_BYTES, "peak {peak} of {max_bytes}");
            result
        };
        let least = |take: &Take| {
            let (mut too_few, mut enough) = (0, 64 << 20);
            while enough - too_few > 1 {
                let midpoint = usize::midpoint(too_few, enough);
                *(if fits(take, midpoint) { &mut enough } else { &mut too_few }) = midpoint;
            }
            enough
        };
        let [long, short] = [&long, &short].map(least);
        let difference = long - short;
        assert!(
            difference * 9 / 10 <= table && table <= difference * 11 / 10,
            "{difference} for {table} bytes"
        );
        let narrow_limits = smallest_limits(&narrow).max_bytes;
        assert!(short > 2 * narrow_limits, "{short} bytes in all columns, {narrow_limits} in its own");
    }
}

/// The last layer alone, and appended.
fn memory_of_layers_is_bounded(bytes: &[u8]) {
    let head = codec::contents(bytes, &Limits::default()).unwrap();
    let last = head.layers.len() - 1;
    let mut clip = decode(&bytes[..head.layer_bytes()[last - 1]], &Limits::default()).unwrap();
    let before = bytes_of(&clip.static_field) + bytes_of(&clip.dynamic_field);
    let one = NonZero::<usize>::MIN;
    let (layers, peak) = peak_of(|| head.decode_layers(bytes, last, &Limits::default(), one).unwrap());
    let decoded = bytes_of(&layers.static_field) + bytes_of(&layers.dynamic_field);
    assert!(before * 4 / 5 <= decoded && decoded <= before * 6 / 5, "half of the rows are in the last layer");
    let ratio = peak as f64 / decoded as f64;
    println!("{:?}, the last layer alone: {decoded} bytes decoded, peak {ratio:.3}", head.coder);
    assert!((1.0..=RATIO_MAX).contains(&ratio), "peak is {ratio} times the decoded size");
    // A column at a time is moved to a place where all of it has room.
    let ((), peak) = peak_of(|| clip.append(layers));
    assert!(peak <= before + decoded + UNCOUNTED_BYTES, "peak {peak} of appending to {before} bytes");
}

fn package_head(bytes: &[u8], limits: &Limits) -> Take {
    codec::package(bytes, limits).unwrap()
}

#[test]
fn memory_is_bounded() {
    memory_of_segments_is_bounded();
    for (coder, sh_degree) in Coder::ALL.into_iter().flat_map(|coder| [(coder, 0), (coder, 3)]) {
        let field = field(Shape { sh_degree, ..Shape::full(40_000) }, 1);
        let plate = static_field(5_000, sh_degree, 2);
        let bytes = package(&field, Some(&plate), &options(coder, &[5_000, 20_000]));
        for threads in [1, 4] {
            let threads = NonZero::new(threads).unwrap();
            let (clip, peak): (Clip, _) =
                peak_of(|| decode_parallel(&bytes, &Limits::default(), threads).unwrap());
            let decoded = bytes_of(&clip.static_field)
                + bytes_of(&clip.dynamic_field)
                + bytes_of(clip.plate.as_ref().unwrap());
            let ratio = peak as f64 / decoded as f64;
            println!(
                "{coder:?}, SH {sh_degree}, {threads} threads: {decoded} bytes decoded, peak {ratio:.3}"
            );
            assert!(ratio >= 1.0, "the allocator does not count");
            assert!(ratio <= RATIO_MAX, "peak is {ratio} times the decoded size");
            // The limits count the whole work space, used or not.
            let limits = Limits { max_bytes: peak, ..Limits::default() };
            let (_, peak) = peak_of(|| decode_parallel(&bytes, &limits, threads));
            assert!(peak <= limits.max_bytes + UNCOUNTED_BYTES, "peak {peak} of {limits:?}");
        }
        memory_of_layers_is_bounded(&bytes);
        let limits = smallest_limits(&bytes);
        let (_, peak) = peak_of(|| decode(&bytes, &limits).unwrap());
        assert!(
            peak <= limits.max_bytes + UNCOUNTED_BYTES,
            "peak {peak} of the least that suffices, {limits:?}"
        );
    }

    // A decompression bomb: 200,000 equal Gaussians.
    let options = options(Coder::Fixed, &[]);
    let bomb = package(&static_field(1, 0, 3).select(&vec![0; 200_000]), None, &options);
    assert!(bomb.len() < 20_000, "{} bytes are not a bomb", bomb.len());
    let limits = Limits { max_bytes: 1 << 20, ..Limits::default() };
    let (result, peak) = peak_of(|| decode(&bomb, &limits));
    assert!(matches!(result, Err(Error::Limits { .. })), "{result:?}");
    assert!(peak <= limits.max_bytes + 3 * bomb.len(), "peak {peak}");

    // A payload that expands to far more than the table announces.
    let mut parts = Parts::new(&bomb);
    parts.set_raw(0, &vec![0; 1 << 28]);
    let expanding = parts.join();
    let (result, peak) = peak_of(|| decode(&expanding, &Limits::default()));
    assert!(matches!(result, Err(Error::Format { .. })), "{result:?}");
    assert!(peak <= 16 << 20, "peak {peak}");

    // Counts at the limit in a file of a few hundred bytes.
    let mut parts = Parts::new(&package(&static_field(3, 0, 4), None, &options));
    common::put_u32(&mut parts.head, 76, 4_000_000);
    let (result, peak) = peak_of(|| decode(&parts.join(), &Limits::default()));
    assert!(result.is_err());
    assert!(peak <= 1 << 16, "peak {peak}");
}
