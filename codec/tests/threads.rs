//! The number of threads changes neither the clip, the bytes nor the error.

mod common;

use std::num::NonZero;

use codec::{Coder, Limits, Source, contents, decode, decode_parallel, encode, encode_parallel};
use common::{Shape, field, info, options, static_field};

fn threads() -> impl Iterator<Item = NonZero<usize>> {
    [1, 2, 3, 64].into_iter().filter_map(NonZero::new)
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
