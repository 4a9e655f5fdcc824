//! The number of threads changes neither the clip, the bytes nor the error. One thread is the caller's alone;
//! chunks of unequal size end in another order on several.

mod common;

use std::collections::HashSet;
use std::num::NonZero;
use std::ops::Range;

use codec::{Coder, Field, LayerEnd, Limits, Region, SectionKind, Source};
use codec::{contents, decode, decode_parallel, encode, encode_parallel};
use common::{Parts, Shape, field, info, options, put_u32, segment_package, static_field, take_package};

/// Numbers of threads that share the work of one: some, an odd number, and more than there are chunks.
fn threads() -> impl Iterator<Item = NonZero<usize>> {
    [2, 3, 7, 64].into_iter().filter_map(NonZero::new)
}

/// A package of 10 chunks: three layers, the first with a plate.
fn package(coder: Coder, threads: NonZero<usize>) -> Vec<u8> {
    let (info, field, plate) = (info(), field(Shape::full(12_000), 1), static_field(4_200, 1, 2));
    let source = Source { info: &info, field: &field, plate: Some(&plate) };
    encode_parallel(&source, &options(coder, &[1_000, 5_000]), threads).unwrap()
}

#[test]
fn any_number_of_threads_writes_the_same_package() {
    let (info, field) = (info(), field(Shape::full(9_000), 1));
    for coder in Coder::ALL {
        let source = Source { info: &info, field: &field, plate: None };
        let options = options(coder, &[2_000]);
        let expected = encode(&source, &options).unwrap();
        for threads in threads() {
            assert!(encode_parallel(&source, &options, threads).unwrap() == expected, "{coder:?}, {threads}");
        }
    }
}

#[test]
fn any_number_of_threads_reads_the_same_clip() {
    for coder in Coder::ALL {
        let package = package(coder, NonZero::new(2).unwrap());
        let second_layer = contents(&package, &Limits::default()).unwrap();
        let second_layer = second_layer.sections.iter().rfind(|section| section.layer == 1).unwrap().end();
        for length in [package.len(), second_layer] {
            let expected = decode(&package[..length], &Limits::default()).unwrap();
            for threads in threads() {
                let clip = decode_parallel(&package[..length], &Limits::default(), threads).unwrap();
                assert!(clip == expected, "{coder:?}, {threads} threads, {length} bytes");
            }
        }
    }
}

/// A segment of a take is the same clip on any number of threads, and damaged the same error.
#[test]
fn any_number_of_threads_reads_the_same_segment() {
    for coder in Coder::ALL {
        let options = options(coder, &[1_000, 5_000]);
        let few = Shape { sh_degree: 0, rotation_rates: false, ..Shape::full(12_000) };
        let large = segment_package(&field(few, 1), Some(&static_field(4_200, 0, 2)), &options, 2.0);
        let wide = segment_package(&field(Shape::full(10), 3), None, &options, 1.0);
        let bytes = take_package(2.0, &[(0.0, 2.0, 1, large.clone()), (0.0, 1.0, 0, wide)]);
        let take = codec::package(&bytes, &Limits::default()).unwrap();
        let mut damaged = large.clone();
        damaged[large.len() / 2] ^= 1;
        for bytes in [large, damaged] {
            let decode = |threads| take.decode_segment(0, &bytes, &Limits::default(), threads);
            let expected = decode(NonZero::<usize>::MIN);
            assert!(threads().all(|threads| decode(threads) == expected), "{coder:?}");
        }
    }
}

/// Each chunk decodes in a package of its own, by a decoder that has seen no other, to its rows of the clip.
#[test]
fn chunks_decode_alone_to_the_rows_of_the_clip() {
    for coder in Coder::ALL {
        let bytes = package(coder, NonZero::new(3).unwrap());
        let (head, parts) = (contents(&bytes, &Limits::default()).unwrap(), Parts::new(&bytes));
        let clip = decode_parallel(&bytes, &Limits::default(), NonZero::new(7).unwrap()).unwrap();
        let plate = clip.plate.unwrap();
        let mut cells = Vec::new();
        let mut compared = 0;
        for (i, section) in head.sections.iter().enumerate() {
            if section.kind == SectionKind::TimeIndex {
                cells = numbers(&parts.sections[i]);
                continue;
            }
            let end = head.layers[usize::from(section.layer)];
            let start = section
                .layer
                .checked_sub(1)
                .map_or(LayerEnd::default(), |before| head.layers[usize::from(before)]);
            let (whole, layer) = match section.region {
                Region::Static => (&clip.static_field, start.static_count..end.static_count),
                Region::Dynamic => (&clip.dynamic_field, start.dynamic_count..end.dynamic_count),
                Region::Plate => (&plate, 0..plate.len()),
            };
            let first = layer.start + CHUNK_ROWS * section.chunk as usize;
            let rows = first..layer.end.min(first + CHUNK_ROWS);
            let alone =
                alone(&parts, i, rows.len(), &cells_of(&cells, first - layer.start..rows.end - layer.start));
            let alone = decode(&alone, &Limits::default()).unwrap().merged();
            assert_eq!(alone.len(), rows.len());
            if coder != Coder::Fixed && section.region == Region::Dynamic {
                // The decoder sorts the rows of the whole layer.
                let layer: HashSet<String> = layer.map(|row| text(whole, row)).collect();
                assert!((0..alone.len()).all(|row| layer.contains(&text(&alone, row))), "section {i}");
            } else {
                let mut rows = rows.enumerate();
                assert!(
                    rows.all(|(row, of_whole)| text(&alone, row) == text(whole, of_whole)),
                    "section {i}"
                );
            }
            compared += alone.len();
        }
        assert_eq!(compared, clip.layers.last().unwrap().total() + plate.len());
    }
}

/// Number of Gaussians in a full chunk.
const CHUNK_ROWS: usize = 4096;

/// All numbers of a Gaussian.
fn text(field: &Field, row: usize) -> String {
    format!("{:?}", field.select(&[row]))
}

/// The package of section `i` alone, a chunk of `rows` Gaussians. `cells` is the time index of dynamic ones.
fn alone(parts: &Parts, i: usize, rows: usize, cells: &[u8]) -> Vec<u8> {
    let Parts { mut head, table, sections } = parts.clone();
    let mut entry = table[i];
    // In layer 0, as its first chunk.
    entry[2] = 0;
    entry[4..8].fill(0);
    let is_dynamic = entry[3] == 1;
    if entry[3] == 2 {
        // A plate is not enough for a package, but its chunks are like static ones.
        entry[3] = 0;
        head[61] = head[66];
    }
    head.drain(84..76 + 8 * usize::from(head[64]));
    head[64] = 1;
    put_u32(&mut head, 68, 0);
    put_u32(&mut head, 76, if is_dynamic { 0 } else { rows });
    put_u32(&mut head, 80, if is_dynamic { rows } else { 0 });
    let mut alone = Parts { head, table: vec![entry], sections: vec![sections[i].clone()] };
    if is_dynamic && !cells.is_empty() {
        let mut index = [0; 24];
        index[..4].copy_from_slice(&[2, 1, 0, 1]);
        put_u32(&mut index, 16, cells.len());
        alone.table.insert(0, index);
        alone.sections.insert(0, cells.to_vec());
    }
    alone.join()
}

/// The LEB128 numbers of a time index: the rows in each of its cells.
fn numbers(mut bytes: &[u8]) -> Vec<usize> {
    let mut numbers = Vec::new();
    while !bytes.is_empty() {
        let length = 1 + bytes.iter().position(|byte| byte & 0x80 == 0).unwrap();
        let (number, rest) = bytes.split_at(length);
        numbers.push(number.iter().rev().fold(0, |sum, byte| sum << 7 | usize::from(byte & 0x7f)));
        bytes = rest;
    }
    numbers
}

/// The time index of a range of rows, given the rows in each cell of all; empty without an index.
fn cells_of(cells: &[usize], rows: Range<usize>) -> Vec<u8> {
    let mut start = 0;
    let mut bytes = Vec::new();
    for &count in cells {
        let end = start + count;
        let inside = end.min(rows.end).saturating_sub(start.max(rows.start));
        bytes.extend([inside as u8 | 0x80, (inside >> 7) as u8]);
        start = end;
    }
    bytes
}

#[test]
fn the_first_damaged_chunk_determines_the_error() {
    for coder in Coder::ALL {
        let bytes = package(coder, NonZero::new(2).unwrap());
        let sections = contents(&bytes, &Limits::default()).unwrap().sections;
        for first in [0, 3, sections.len() - 2] {
            let mut damaged = bytes.clone();
            sections[first..].iter().for_each(|section| damaged[section.offset] ^= 1);
            let expected = decode(&damaged, &Limits::default()).unwrap_err();
            for threads in threads() {
                let error = decode_parallel(&damaged, &Limits::default(), threads).unwrap_err();
                assert_eq!(error, expected, "{coder:?}, {threads} threads");
            }
        }
    }
}

/// If the limits have memory for one thread only, one thread decodes.
#[test]
fn additional_threads_stay_within_the_limits() {
    for coder in Coder::ALL {
        let package = package(coder, NonZero::new(2).unwrap());
        let fits = |max_bytes: &usize| {
            decode(&package, &Limits { max_bytes: *max_bytes, ..Limits::default() }).is_ok()
        };
        let steps: Vec<usize> = (1..200).map(|step| step << 16).collect();
        let max_bytes = steps[steps.partition_point(|max_bytes| !fits(max_bytes))];
        for step in [0, 1, 30] {
            let limits = Limits { max_bytes: max_bytes + (step << 16), ..Limits::default() };
            let expected = decode(&package, &limits).unwrap();
            for threads in threads() {
                assert!(decode_parallel(&package, &limits, threads).unwrap() == expected);
            }
        }
        let limits = Limits { max_bytes: max_bytes - (1 << 16), ..Limits::default() };
        for threads in threads() {
            assert_eq!(decode_parallel(&package, &limits, threads), decode(&package, &limits));
        }
    }
}
