//! Decoding takes work linear in the package and in what its head announces, for packages that are large in
//! each of their dimensions, valid or not.

use std::num::NonZero;

use super::COUNTS;
use crate::{
    Coder, EncodeOptions, Limits, Precision, Source, Take, Viewpoint, contents, decode_parallel, encode,
    format::{
        CHUNK_ROWS, ENTRY_BYTES, LAYERS_MAX, NAME_BYTES_MAX, RESIDENT_MAX, SEGMENTS_MAX, VIEWPOINTS_MAX,
    },
};
use common::{
    Parts, Rng, Shape, TakeParts, field, info, options, package, segment_package, small_take, static_field,
    take_package,
};

#[path = "../../tests/common/mod.rs"]
mod common;

/// Passes over the section table, half of them over the sections that the counts require.
const PASSES: usize = 12;

/// Most symbols of a Gaussian: 67 numbers of at most 32 symbols, 48 levels of the grid of at most 6, and those
/// of its quantiser indices, its rotation and its position.
const SYMBOLS_PER_ROW: usize = 67 * 32 + 48 * 6 + 26;

/// Most visits to a Gaussian: 24 neighbours, a run of cells on each of 48 levels of the grid and the run of all,
/// its cell of the time index, and an exchange with another row.
const VISITS_PER_ROW: usize = 24 + 48 + 1 + 1 + 2;

/// Decodes a package, which may be damaged, on one thread and on several, and checks the work of the calling
/// thread. Returns the work on one thread, by [`super::Work`].
fn work(package: &[u8]) -> [usize; 4] {
    let limits = Limits::default();
    // The Gaussians and uncompressed bytes that the head announces, and the entries of its table.
    let (rows, raw_bytes, entries) = match contents(package, &limits) {
        Ok(head) => (
            head.layers.last().map_or(0, |end| end.total()) + head.plate_len,
            head.sections.iter().map(|section| section.raw_length).sum(),
            head.sections.len(),
        ),
        Err(_) => (0, 0, package.len() / ENTRY_BYTES),
    };
    let bounds = [
        ("bytes", 2 * package.len() + raw_bytes),
        ("sections", PASSES * (entries + 1)),
        ("symbols", SYMBOLS_PER_ROW * rows),
        ("rows", VISITS_PER_ROW * rows),
    ];
    let [_, counts] = [16, 1].map(|threads| {
        COUNTS.set([0; 4]);
        let _ = decode_parallel(package, &limits, NonZero::new(threads).unwrap());
        let counts = COUNTS.get();
        for ((unit, bound), count) in bounds.into_iter().zip(counts) {
            assert!(count <= bound, "{threads} threads: {count} {unit} in place of at most {bound}");
        }
        counts
    });
    counts
}

/// Checks that a package with `factor` times as much in it takes hardly more than that factor more visits and symbols:
/// of more Gaussians, each is coded a little more finely. Bytes are left out: a smaller chunk is compressed less.
fn check_growth(small: [usize; 4], large: [usize; 4], factor: usize) {
    for unit in 1..4 {
        let most = factor * small[unit] * 3 / 2;
        assert!(large[unit] <= most, "unit {unit}: {small:?} grows to {large:?}");
    }
}

#[test]
fn many_gaussians() {
    for coder in Coder::ALL {
        let of_rows = |rows| {
            let shape = Shape { sh_degree: 0, motion_order: 1, rotation_rates: false, ..Shape::full(rows) };
            work(&package(&field(shape, 1), None, &options(coder, &[])))
        };
        check_growth(of_rows(4 * CHUNK_ROWS), of_rows(16 * CHUNK_ROWS), 4);
    }
}

#[test]
fn all_columns() {
    for coder in Coder::ALL {
        let of_rows = |rows| {
            let plate = static_field(rows, 3, 2);
            work(&package(&field(Shape::full(rows), 1), Some(&plate), &options(coder, &[rows / 2])))
        };
        check_growth(of_rows(CHUNK_ROWS / 2), of_rows(2 * CHUNK_ROWS), 4);
    }
}

#[test]
fn many_layers() {
    for coder in Coder::ALL {
        let of_layers = |layers: usize| {
            let ends: Vec<usize> = (1..layers).map(|layer| 500 * layer).collect();
            let bytes = package(&field(Shape::full(500 * layers), 1), None, &options(coder, &ends));
            // Cuts end in a layer, in its time index and in its chunks.
            for length in (0..bytes.len()).step_by(bytes.len() / 12) {
                work(&bytes[..length]);
            }
            work(&bytes)
        };
        check_growth(of_layers(LAYERS_MAX / 4), of_layers(LAYERS_MAX), 4);
    }
}

/// Layers that arrive one by one take the work of one decoding, but for the table: nothing of a layer is done twice.
#[test]
fn layers_one_by_one() {
    for coder in Coder::ALL {
        let ends: Vec<usize> = (1..LAYERS_MAX).map(|layer| 500 * layer).collect();
        let bytes = package(&field(Shape::full(500 * LAYERS_MAX), 1), None, &options(coder, &ends));
        let limits = Limits::default();
        let (head, one) = (contents(&bytes, &limits).unwrap(), NonZero::<usize>::MIN);
        let ends = head.layer_bytes();
        let counted = |work: &dyn Fn()| {
            COUNTS.set([0; 4]);
            work();
            COUNTS.get()
        };
        let whole = counted(&|| drop(decode_parallel(&bytes, &limits, one).unwrap()));
        let mut sum = counted(&|| drop(decode_parallel(&bytes[..ends[0]], &limits, one).unwrap()));
        for (layer, end) in ends.iter().enumerate().skip(1) {
            let counts = counted(&|| drop(head.decode_layers(&bytes[..*end], layer, &limits, one).unwrap()));
            sum.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        }
        for (unit, (sum, whole)) in sum.into_iter().zip(whole).enumerate().filter(|(unit, _)| *unit != 1) {
            assert!(sum <= whole + whole / 10, "{coder:?}, unit {unit}: {sum} one by one, {whole} at once");
        }
        assert!(sum[1] <= LAYERS_MAX * PASSES * (head.sections.len() + 1), "{} sections", sum[1]);
    }
}

#[test]
fn many_sections_and_viewpoints() {
    let mut info = info();
    let viewpoint = Viewpoint { name: "v".repeat(NAME_BYTES_MAX), ..info.viewpoints[0].clone() };
    info.viewpoints = vec![viewpoint; VIEWPOINTS_MAX];
    for coder in Coder::ALL {
        let source = Source { info: &info, field: &field(Shape::full(300), 1), plate: None };
        let parts = Parts::new(&encode(&source, &options(coder, &[100])).unwrap());
        // Unknown sections after, before and between the others.
        for at in [parts.table.len(), 0, 1] {
            let of_sections = |count: usize| {
                let mut parts = parts.clone();
                for i in 0..count {
                    let mut entry = [0; ENTRY_BYTES];
                    entry[0] = 200;
                    parts.table.insert(at, entry);
                    parts.sections.insert(at, vec![i as u8; i % 4]);
                }
                work(&parts.join())
            };
            check_growth(of_sections(500), of_sections(8000), 16);
        }
    }
}

/// Pairs of Gaussians in one cell each, in the finest grid: the most runs of cells.
#[test]
fn deep_trees() {
    let of_pairs = |pairs: usize| {
        let single = static_field(pairs, 0, 3);
        let mut both = single.select(&(0..2 * pairs).map(|i| i / 2).collect::<Vec<_>>());
        both.log_scales.fill([-20.0; 3]);
        let precision = Precision { footprint: Some(1e-9), ..Precision::default() };
        let options = EncodeOptions { precision, ..options(Coder::Rans, &[]) };
        let bytes = package(&both, None, &options);
        let axis_bits = Parts::new(&bytes).sections[0][24];
        assert_eq!(axis_bits, 16, "the grid is as fine as it can be");
        work(&bytes)
    };
    let counts = of_pairs(CHUNK_ROWS / 2);
    assert!(counts[3] > 36 * CHUNK_ROWS, "{counts:?}: runs are short");
    check_growth(counts, of_pairs(2 * CHUNK_ROWS), 4);
}

/// Symbols that have nothing to do with Gaussians, and are far more or fewer than theirs.
#[test]
fn foreign_symbols() {
    let bytes = package(&field(Shape::full(2 * CHUNK_ROWS), 1), None, &options(Coder::Rans, &[]));
    let parts = Parts::new(&bytes);
    let mut rng = Rng(9);
    for at in 0..parts.sections.len() {
        for length in [0, 1, 100, 300_000] {
            for fill in [Some(0), Some(0x55), Some(0xff), None] {
                // The head of a chunk.
                let mut payload = parts.sections[at][..26].to_vec();
                payload[24] = 16;
                payload.extend((0..length).map(|_| fill.unwrap_or_else(|| rng.bits() as u8)));
                work(&parts.with_payload(at, payload));
            }
        }
    }
}

#[test]
fn damage_under_valid_checksums() {
    for coder in Coder::ALL {
        let field = field(Shape { sh_degree: 1, ..Shape::full(CHUNK_ROWS + 500) }, 1);
        let parts = Parts::new(&package(&field, Some(&static_field(50, 1, 2)), &options(coder, &[1000])));
        let mut rng = Rng(4);
        let change = |bytes: &mut [u8], rng: &mut Rng| {
            let at = rng.below(bytes.len());
            bytes[at] ^= 1 << rng.below(8);
        };
        for _ in 0..80 {
            let mut parts = parts.clone();
            let section = rng.below(parts.sections.len());
            match rng.below(3) {
                0 => change(&mut parts.head, &mut rng),
                1 => change(&mut parts.table[section], &mut rng),
                _ => change(&mut parts.sections[section], &mut rng),
            }
            work(&parts.join());
        }
    }
}

/// Reads the head of a take on one thread, and returns its work.
fn work_of_head(take: &[u8]) -> (Take, [usize; 4]) {
    COUNTS.set([0; 4]);
    let read = crate::package(take, &Limits::default()).unwrap();
    (read, COUNTS.get())
}

#[test]
fn many_segments() {
    // As many segments as may hold an instant, and one after the other.
    for overlap in [1.0, RESIDENT_MAX as f64] {
        let of_segments = |count: usize| {
            let mut parts = TakeParts::new(&small_take(Coder::Fixed)).unwrap();
            let entry = parts.entries[1].clone();
            parts.segments = Vec::new();
            parts.head[12..16].copy_from_slice(&1e5f32.to_le_bytes());
            parts.head[76..84].copy_from_slice(&1e5f64.to_le_bytes());
            let at = |i: usize| {
                let mut entry = entry.clone();
                entry[..8].copy_from_slice(&(i as f64).to_le_bytes());
                entry[8..16].copy_from_slice(&overlap.to_le_bytes());
                entry
            };
            parts.entries = (0..count).map(at).collect();
            let bytes = parts.join_as_they_are();
            let (take, counts) = work_of_head(&bytes);
            assert_eq!(take.segments.len(), count);
            let [read, visits, ..] = counts;
            assert!(read <= 2 * bytes.len(), "{read} bytes of {}", bytes.len());
            assert!(visits <= (3 + RESIDENT_MAX) * count, "{visits} visits to {count} segments");
            COUNTS.set([0; 4]);
            assert!(take.resident_max() > 0);
            let visits = COUNTS.get()[1];
            assert!(visits <= (2 + RESIDENT_MAX) * count, "{visits} visits to {count} segments");
            counts
        };
        check_growth(of_segments(SEGMENTS_MAX / 16), of_segments(SEGMENTS_MAX), 16);
    }
}

/// Decoding a segment takes the work of its own package, however long the take.
#[test]
fn segments_of_a_long_take() {
    for coder in Coder::ALL {
        let segment = segment_package(&field(Shape::full(300), 1), None, &options(coder, &[100]), 1.0);
        let alone = work(&segment);
        for count in [1, 1000] {
            let segments: Vec<_> = (0..count).map(|i| (i as f64, 1.0, 0, segment.clone())).collect();
            let (take, _) = work_of_head(&take_package(count as f64, &segments));
            COUNTS.set([0; 4]);
            take.decode_segment(count - 1, &segment, &Limits::default(), NonZero::<usize>::MIN).unwrap();
            let counts = COUNTS.get();
            // The table of a segment is read twice more: for its prefixes.
            let sections = 2 * (contents(&segment, &Limits::default()).unwrap().sections.len() + 1);
            assert_eq!([counts[0], counts[2], counts[3]], [alone[0], alone[2], alone[3]]);
            assert!(counts[1] <= alone[1] + sections, "{counts:?} in place of {alone:?}");
        }
    }
}
