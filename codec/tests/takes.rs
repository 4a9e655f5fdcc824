//! Takes: what is written is read, and segments decode to their clips in the columns of the take.

mod common;

use std::num::NonZero;

use codec::{
    Clip, ClipInfo, Coder, Contents, Error, Field, FormatError, Limits, Package, SegmentPackage, Source,
    Take, contents, decode, encode, encode_take_head, package,
};
use common::{Shape, field, info, options, static_field};

const ONE: NonZero<usize> = NonZero::<usize>::MIN;

/// The package of a segment of `duration_s` seconds.
fn segment(coder: Coder, field: &Field, plate: Option<&Field>, duration_s: f64) -> Vec<u8> {
    let info = ClipInfo { duration_s: duration_s as f32, viewpoints: Vec::new(), ..info() };
    encode(&Source { info: &info, field, plate }, &options(coder, &[field.len() / 2])).unwrap()
}

fn contents_of(package: &[u8]) -> Contents {
    contents(package, &Limits::default()).unwrap()
}

fn take_of(bytes: &[u8]) -> Take {
    match package(bytes, &Limits::default()).unwrap() {
        Package::Take(take) => take,
        Package::Clip(_) => panic!("a clip"),
    }
}

/// Joins a head and the packages of its segments, `(start, duration, level, package)`.
fn join(duration_s: f64, segments: &[(f64, f64, u8, Vec<u8>)]) -> Vec<u8> {
    let heads: Vec<Contents> = segments.iter().map(|segment| contents_of(&segment.3)).collect();
    let entry = |((start_s, duration_s, level, _), contents): (&(f64, f64, u8, Vec<u8>), _)| SegmentPackage {
        start_s: *start_s,
        duration_s: *duration_s,
        level: *level,
        contents,
    };
    let entries: Vec<SegmentPackage> = segments.iter().zip(&heads).map(entry).collect();
    let mut bytes = encode_take_head(&info(), duration_s, &entries).unwrap();
    segments.iter().for_each(|segment| bytes.extend_from_slice(&segment.3));
    bytes
}

#[test]
fn segments_decode_to_their_clips() {
    for coder in Coder::ALL {
        let top = segment(coder, &static_field(9, 1, 1), Some(&static_field(4, 2, 2)), 3.5);
        let still = Shape { motion_order: 1, rotation_rates: false, sh_degree: 0, ..Shape::full(30) };
        let (first, second) = (field(still, 3), field(Shape::full(20), 4));
        let segments = [
            (0.0, 3.5, 2, top),
            (0.0, 2.0, 0, segment(coder, &first, None, 2.0)),
            (1.0, 2.5, 0, segment(coder, &second, None, 2.5)),
        ];
        let bytes = join(3.5, &segments);
        let take = take_of(&bytes);
        assert_eq!((take.sh_degree, take.motion_order, take.rotation_rates), (3, 3, true));
        assert_eq!((take.plate_len, take.plate_sh_degree), (4, 2));
        assert_eq!(take.package_bytes(), bytes.len() as u64);
        for (index, (_, _, _, alone)) in segments.iter().enumerate() {
            let entry = &take.segments[index];
            let start = entry.offset as usize;
            assert_eq!(&bytes[start..start + entry.bytes()], alone);
            let clip = take.decode_segment(index, alone, &Limits::default(), ONE).unwrap();
            let expected = decode(alone, &Limits::default()).unwrap();
            assert_eq!(clip.dynamic_field.sh_degree, 3);
            assert_eq!(narrowed(clip, &expected), expected);
        }
    }
}

/// The clip without the columns that `narrow` lacks, which must be zero.
fn narrowed(mut clip: Clip, narrow: &Clip) -> Clip {
    let narrow_sh = |field: &mut Field, degree: u8| {
        let counts = [field.sh_degree, degree].map(codec::sh_coefficients);
        let rows = field.sh.chunks(counts[0]);
        assert!(rows.clone().all(|row| row[counts[1]..].iter().all(|c| *c == [0.0; 3])));
        field.sh = rows.flat_map(|row| row[..counts[1]].to_vec()).collect();
        field.sh_degree = degree;
    };
    narrow_sh(&mut clip.static_field, narrow.static_field.sh_degree);
    narrow_sh(&mut clip.dynamic_field, narrow.dynamic_field.sh_degree);
    if let (Some(plate), Some(narrow)) = (&mut clip.plate, &narrow.plate) {
        narrow_sh(plate, narrow.sh_degree);
    }
    let temporal = clip.dynamic_field.temporal.as_mut().unwrap();
    let narrow = narrow.dynamic_field.temporal.as_ref().unwrap();
    let orders = [temporal.motion_order, narrow.motion_order].map(usize::from);
    if orders[0] > orders[1] {
        let rows = temporal.motion.chunks(orders[0]);
        assert!(rows.clone().all(|row| row[orders[1]..].iter().all(|v| *v == [0.0; 3])));
        temporal.motion = rows.flat_map(|row| row[..orders[1]].to_vec()).collect();
        temporal.motion_order = narrow.motion_order;
    }
    if narrow.rotation_rates.is_none()
        && let Some(rates) = temporal.rotation_rates.take()
    {
        assert!(rates.iter().all(|rate| *rate == [0.0; 4]));
    }
    clip
}

#[test]
fn a_clip_is_a_take_of_one_segment() {
    for coder in Coder::ALL {
        let bytes = segment(coder, &field(Shape::full(20), 1), Some(&static_field(3, 0, 2)), 1.32);
        let take = Take::from(&contents_of(&bytes));
        assert_eq!((take.segments.len(), take.package_bytes()), (1, bytes.len() as u64));
        assert_eq!(take.resident_max(), 23);
        let clip = take.decode_segment(0, &bytes, &Limits::default(), ONE).unwrap();
        assert_eq!(clip, decode(&bytes, &Limits::default()).unwrap());
        let head = package(&bytes, &Limits::default()).unwrap();
        assert_eq!(head, Package::Clip(contents_of(&bytes)));
    }
}

#[test]
fn a_take_is_no_clip() {
    let clip = segment(Coder::Fixed, &field(Shape::full(20), 1), None, 2.0);
    let bytes = join(2.0, &[(0.0, 2.0, 0, clip)]);
    let expected = Error::Format { offset: 64, error: FormatError::Take };
    assert_eq!(decode(&bytes, &Limits::default()).unwrap_err(), expected);
    assert_eq!(contents(&bytes, &Limits::default()).unwrap_err(), expected);
}
