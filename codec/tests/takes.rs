//! Takes: what is written is read, the rules of a table, and segments that decode to their clips in the columns of
//! the take.

mod common;

use std::num::NonZero;

use codec::{
    Clip, ClipInfo, Coder, Contents, EncodeError, Error, Field, FormatError, Limits, PixelFilter, Segment,
    SegmentLayer, SegmentPackage, Take, contents, decode, encode_take_head, package, sh_coefficients,
    take_order,
};
use common::{
    Shape, TakeParts, TakeSegment, field, info, options, put_u32, segment_package, small_take, static_field,
    take_package,
};

const ONE: NonZero<usize> = NonZero::<usize>::MIN;

/// The package of a segment of `duration_s` seconds in two layers.
fn segment(coder: Coder, field: &Field, plate: Option<&Field>, duration_s: f64) -> Vec<u8> {
    segment_package(field, plate, &options(coder, &[field.len() / 2]), duration_s)
}

fn contents_of(package: &[u8]) -> Contents {
    contents(package, &Limits::default()).unwrap()
}

fn take_of(bytes: &[u8]) -> Take {
    package(bytes, &Limits::default()).unwrap()
}

/// The bytes of a segment in a take package.
fn bytes_of<'a>(take: &'a [u8], segment: &Segment) -> &'a [u8] {
    &take[segment.offset as usize..][..segment.bytes()]
}

fn decode_segment(take: &Take, index: usize, bytes: &[u8]) -> Result<Clip, Error> {
    take.decode_segment(index, bytes, &Limits::default(), ONE)
}

#[test]
fn segments_decode_to_their_clips_in_the_columns_of_the_take() {
    for coder in Coder::ALL {
        let top = segment(coder, &static_field(9, 1, 1), Some(&static_field(4, 2, 2)), 3.5);
        let few = Shape { motion_order: 1, rotation_rates: false, sh_degree: 0, ..Shape::full(30) };
        let segments: [TakeSegment; 3] = [
            (0.0, 3.5, 2, top),
            (0.0, 2.0, 0, segment(coder, &field(few, 3), None, 2.0)),
            (1.0, 2.5, 0, segment(coder, &field(Shape::full(20), 4), None, 2.5)),
        ];
        let bytes = take_package(3.5, &segments);
        assert_eq!(bytes, take_package(3.5, &segments), "writing is deterministic");
        let take = take_of(&bytes);
        assert_eq!((take.sh_degree, take.motion_order, take.rotation_rates), (3, 3, true));
        assert_eq!((take.plate_len, take.plate_sh_degree), (4, 2));
        assert_eq!(take.coder, coder);
        assert_eq!(take.info, ClipInfo { duration_s: 3.5, ..info() });
        assert_eq!(take.package_bytes(), bytes.len() as u64);
        assert_eq!(
            take.head_bytes,
            bytes.len() - segments.iter().map(|segment| segment.3.len()).sum::<usize>()
        );
        for (index, (start_s, duration_s, level, alone)) in segments.iter().enumerate() {
            let (entry, head) = (&take.segments[index], contents_of(alone));
            assert_eq!((entry.start_s, entry.duration_s, entry.level), (*start_s, *duration_s, *level));
            assert_eq!(bytes_of(&bytes, entry), alone);
            assert_eq!(entry.head_crc, head.head_crc);
            let prefixes = entry.layers.iter().map(|layer| layer.bytes);
            assert!(prefixes.eq(head.layer_bytes()), "{entry:?}");
            for corner in 0..3 {
                assert!(take.bounds[0][corner] <= head.bounds[0][corner]);
                assert!(take.bounds[1][corner] >= head.bounds[1][corner]);
            }
            // Every prefix of layers, and a little more.
            for (layers, prefix) in (1..).zip(&entry.layers) {
                for length in [prefix.bytes, (prefix.bytes + 1).min(alone.len())] {
                    let expected = decode(&alone[..length], &Limits::default()).unwrap();
                    let clip = decode_segment(&take, index, &alone[..length]).unwrap();
                    assert_eq!(clip.layers.len(), layers);
                    let plate = clip.plate.as_ref().map_or(0, Field::len);
                    assert_eq!(clip.len() + plate, prefix.gaussians);
                    check_columns(&clip, &take);
                    assert_eq!(narrowed(clip, &expected), expected);
                }
            }
        }
    }
}

/// Checks that a clip is valid and has the columns of a take.
fn check_columns(clip: &Clip, take: &Take) {
    common::check_fields(clip);
    assert_eq!(clip.static_field.sh_degree, take.sh_degree);
    assert_eq!(clip.dynamic_field.sh_degree, take.sh_degree);
    assert!(clip.plate.as_ref().is_none_or(|plate| plate.sh_degree == take.plate_sh_degree));
    let temporal = clip.dynamic_field.temporal.as_ref().unwrap();
    assert_eq!(temporal.motion_order, take.motion_order);
    assert_eq!(temporal.rotation_rates.is_some(), take.rotation_rates);
}

/// The clip without the columns that `narrow` lacks, which must be zero.
fn narrowed(mut clip: Clip, narrow: &Clip) -> Clip {
    fn narrow_rows(column: &mut Vec<[f32; 3]>, from: usize, to: usize) {
        if from > to {
            let rows = column.chunks(from);
            assert!(rows.clone().all(|row| row[to..].iter().all(|v| *v == [0.0; 3])));
            *column = rows.flat_map(|row| row[..to].to_vec()).collect();
        }
    }
    let narrow_sh = |field: &mut Field, degree: u8| {
        narrow_rows(&mut field.sh, sh_coefficients(field.sh_degree), sh_coefficients(degree));
        field.sh_degree = degree;
    };
    narrow_sh(&mut clip.static_field, narrow.static_field.sh_degree);
    narrow_sh(&mut clip.dynamic_field, narrow.dynamic_field.sh_degree);
    if let (Some(plate), Some(narrow)) = (&mut clip.plate, &narrow.plate) {
        narrow_sh(plate, narrow.sh_degree);
    }
    let temporal = clip.dynamic_field.temporal.as_mut().unwrap();
    let narrow = narrow.dynamic_field.temporal.as_ref().unwrap();
    narrow_rows(&mut temporal.motion, temporal.motion_order.into(), narrow.motion_order.into());
    temporal.motion_order = narrow.motion_order;
    if narrow.rotation_rates.is_none() {
        let rates = temporal.rotation_rates.take();
        assert!(rates.iter().flatten().all(|rate| *rate == [0.0; 4]));
    }
    clip
}

#[test]
fn all_segments_of_a_take_have_its_near_distance() {
    for coder in Coder::ALL {
        let made = |near: [f32; 3]| {
            let [plate, top, short] = near.map(|near| Field { near, ..field(Shape::full(20), 4) });
            let plate = Field { near: plate.near, ..static_field(4, 0, 2) };
            let top = segment(coder, &top, Some(&plate), 3.5);
            take_package(3.5, &[(0.0, 3.5, 1, top), (0.0, 2.0, 0, segment(coder, &short, None, 2.0))])
        };
        let without = made([0.0; 3]);
        assert_eq!((take_of(&without).near, without[63] & 16), (0.0, 0), "{coder:?}");
        for near in [[0.0, 0.25, 0.5], [0.0, 0.5, 0.0], [0.5, 0.0, 0.25]] {
            let bytes = made(near);
            let take = take_of(&bytes);
            assert_eq!((take.near, bytes[63] & 16), (0.5, 16), "{coder:?} {near:?}");
            assert_eq!(take.head_bytes, take_of(&without).head_bytes + 4);
            for (index, entry) in take.segments.iter().enumerate() {
                let alone = bytes_of(&bytes, entry);
                let all = decode_segment(&take, index, alone).unwrap();
                let plate = all.plate.as_ref().map_or(0.5, |plate| plate.near);
                let found = [all.static_field.near, all.dynamic_field.near, plate, all.near()];
                assert_eq!(found, [0.5; 4], "{coder:?} {near:?}, segment {index}");
                let mut grown = decode_segment(&take, index, &alone[..entry.layers[0].bytes]).unwrap();
                let further = take.decode_segment_layers(index, alone, 1, &Limits::default(), ONE);
                grown.append(further.unwrap());
                assert_eq!(grown, all, "{coder:?} {near:?}, segment {index}");
            }
        }
        for bad in [f32::NAN, -0.5, 0.0, f32::INFINITY] {
            let mut parts = TakeParts::new(&made([0.5; 3])).unwrap();
            let at = parts.head.len() - 4;
            parts.head[at..].copy_from_slice(&bad.to_le_bytes());
            let error = package(&parts.join(), &Limits::default()).unwrap_err().to_string();
            assert_eq!(error, format!("bad near distance: {bad:?}, at byte {at}"));
        }
    }
}

#[test]
fn a_clip_is_a_take_of_one_segment() {
    for (coder, filter) in
        Coder::ALL.into_iter().flat_map(|coder| PixelFilter::ALL.map(|filter| (coder, filter)))
    {
        let field = Field { filter, ..field(Shape::full(20), 1) };
        let bytes = segment(coder, &field, Some(&static_field(3, 0, 2)), 1.32);
        let take = take_of(&bytes);
        assert_eq!(take, Take::from(&contents_of(&bytes)));
        assert_eq!((take.head_bytes, take.segments[0].offset), (0, 0), "the head belongs to the segment");
        assert_eq!((take.segments.len(), take.package_bytes()), (1, bytes.len() as u64));
        assert_eq!((take.resident_max(), take.duration_s), (23, f64::from(1.32f32)));
        assert_eq!(decode_segment(&take, 0, &bytes), decode(&bytes, &Limits::default()));
        let first = &bytes[..take.segments[0].layers[0].bytes];
        assert_eq!(decode_segment(&take, 0, first), decode(first, &Limits::default()));
    }
}

#[test]
fn a_take_is_no_clip_and_no_segment() {
    let bytes = small_take(Coder::Fixed);
    let is_take = |offset| Error::Format { offset, error: FormatError::Take };
    assert_eq!(decode(&bytes, &Limits::default()).unwrap_err(), is_take(64));
    assert_eq!(contents(&bytes, &Limits::default()).unwrap_err(), is_take(64));
    assert_eq!(is_take(64).to_string(), "the package is a take of several segments, not a clip, at byte 64");
    let mut outer = TakeParts::new(&bytes).unwrap();
    outer.segments[1] = bytes;
    let outer = outer.join();
    let take = take_of(&outer);
    let entry = &take.segments[1];
    let error = decode_segment(&take, 1, bytes_of(&outer, entry)).unwrap_err();
    assert_eq!(error, is_take(entry.offset as usize + 64));
}

/// A take without packages, of segments `(start, duration)` of one layer.
fn take_of_spans(duration_s: f64, spans: &[(f64, f64)]) -> Take {
    let bytes = segment(Coder::Fixed, &static_field(8, 0, 1), None, 1.0);
    let mut take = Take::from(&contents_of(&bytes));
    let layers = vec![SegmentLayer { bytes: 100, gaussians: 5 }];
    let segment = |&(start_s, duration_s): &(f64, f64)| Segment {
        start_s,
        duration_s,
        layers: layers.clone(),
        ..take.segments[0].clone()
    };
    take.segments = spans.iter().map(segment).collect();
    take.duration_s = duration_s;
    take
}

#[test]
fn spans_are_half_open_but_for_the_end_of_the_take() {
    let take = take_of_spans(3.0, &[(-1.0, 5.0), (0.0, 2.0), (1.0, 2.0), (2.0, 1.5)]);
    let at = |t_s| take.at(t_s).collect::<Vec<_>>();
    assert_eq!(at(0.0), [0, 1]);
    assert_eq!(at(-7.0), [0, 1], "cut to the take");
    assert_eq!(at(1.0), [0, 1, 2]);
    assert_eq!(at(2.0 - 1e-8), [0, 1, 2]);
    assert_eq!(at(2f64.next_down()), [0, 2, 3], "it is 2 rounded");
    assert_eq!(at(2.0), [0, 2, 3]);
    assert_eq!(at(3.0), [0, 2, 3], "segment 2 ends with the take");
    assert_eq!(at(9.0), [0, 2, 3], "cut to the take");
    assert_eq!(take.segments[0].clip_time(1.5), 0.5);
    assert_eq!(take.segments[0].end_s(), 4.0);
    assert_eq!(take.resident_max(), 15);
}

#[test]
fn the_largest_residents_are_those_of_one_instant() {
    let mut take =
        take_of_spans(10.0, &[(-3.0, 4.0), (-2.0, 3.0), (0.0, 5.0), (1.0, 1.0), (2.0, 8.0), (7.0, 3.0)]);
    for (segment, gaussians) in take.segments.iter_mut().zip([1, 2, 4, 100, 16, 32]) {
        segment.layers[0].gaussians = gaussians;
    }
    assert_eq!(take.resident_max(), 104);
    let instants = (0..=1000).map(|step| {
        let at = take.at(f64::from(step) / 100.0);
        at.map(|index| take.segments[index].gaussians()).sum::<usize>()
    });
    assert_eq!(instants.max(), Some(take.resident_max()));
    take.segments.clear();
    assert_eq!((take.resident_max(), take.package_bytes()), (0, take.head_bytes as u64));
}

#[test]
fn order_puts_segments_that_span_the_take_first() {
    let spans =
        [(1.0, 2.0), (0.0, 2.0), (0.0, 4.0), (-1.0, 4.0), (0.0, 1.0), (-2.0, 8.0), (1.0, 9.0), (0.0, 5.0)];
    assert_eq!(take_order(4.0, &spans), [5, 7, 2, 3, 1, 4, 6, 0]);
}

/// The segments of [`small_take`] as they are given to the writer, and their heads.
fn heads(coder: Coder) -> Vec<Contents> {
    let bytes = small_take(coder);
    take_of(&bytes).segments.iter().map(|segment| contents_of(bytes_of(&bytes, segment))).collect()
}

/// The message with which the writer refuses segments `(start, duration, head)`.
fn write_error(duration_s: f64, segments: &[(f64, f64, &Contents)]) -> String {
    let entry = |&(start_s, duration_s, contents): &(f64, f64, _)| SegmentPackage {
        start_s,
        duration_s,
        level: 0,
        contents,
    };
    let entries: Vec<_> = segments.iter().map(entry).collect();
    encode_take_head(&info(), duration_s, &entries).unwrap_err().to_string()
}

#[test]
fn segments_that_make_no_take_are_refused_by_the_writer() {
    let fixed = heads(Coder::Fixed);
    let [plate, few, all] = &fixed[..] else { panic!("three segments") };
    let message = |text: &str| format!("the take cannot be written: {text}");
    assert_eq!(write_error(2.0, &[]), message("it has no segments"));
    for (duration_s, written) in
        [(0.0, "0.0"), (-1.0, "-1.0"), (f64::NAN, "NaN"), (1e300, "inf"), (1e-300, "0.0")]
    {
        let error = write_error(duration_s, &[(0.0, 2.0, few)]);
        assert_eq!(error, format!("the clip's metadata cannot be packaged: bad duration: {written}"));
    }
    for span in [
        (0.0, 0.0),
        (0.0, -1.0),
        (f64::NAN, 1.0),
        (0.0, f64::INFINITY),
        (2.0, 1.0),
        (-1.0, 1.0),
        (1.0, 1e-20),
        (1e308, 1e308),
    ] {
        let expected = format!("bad span of a segment (start, duration): {span:?}, segment 1");
        assert_eq!(write_error(2.0, &[(0.0, 2.0, few), (span.0, span.1, all)]), message(&expected));
    }
    let order = "bad order of segments: (0.0, 2.0), segment 1";
    assert_eq!(write_error(3.0, &[(1.0, 2.0, few), (0.0, 2.0, all)]), message(order));
    let order = "bad order of segments: (0.0, 3.0), segment 1";
    assert_eq!(write_error(3.0, &[(0.0, 1.0, few), (0.0, 3.0, all)]), message(order));
    let many: Vec<_> = (0..33).map(|i| (0.1 * f64::from(i), 4.0, few)).collect();
    let error = write_error(5.0, &many);
    assert_eq!(error, message("bad number of segments that hold one instant: 33, segment 32"));
    assert!(
        encode_take_head(
            &info(),
            5.0,
            &many[..32]
                .iter()
                .map(|&(start_s, duration_s, contents)| SegmentPackage {
                    start_s,
                    duration_s,
                    level: 0,
                    contents
                })
                .collect::<Vec<_>>()
        )
        .is_ok()
    );
    // As many, but one ends as the last begins.
    let mut next: Vec<_> = many.clone();
    next[32].0 = 4.0;
    assert_eq!(next.len(), 33);
    let entries: Vec<_> = next
        .iter()
        .map(|&(start_s, duration_s, contents)| SegmentPackage { start_s, duration_s, level: 0, contents })
        .collect();
    assert!(encode_take_head(&info(), 5.0, &entries).is_ok());
    let too_many: Vec<_> = (0..65_537).map(|i| (f64::from(i), 1.0, few)).collect();
    assert_eq!(write_error(70_000.0, &too_many), message("bad number of segments: 65537"));

    let rans = heads(Coder::Rans);
    let error = write_error(3.0, &[(0.0, 2.0, few), (1.0, 2.0, &rans[1])]);
    assert_eq!(error, message("its segments have different coders"));
    let mip = Contents { filter: PixelFilter::Mip, ..all.clone() };
    assert_eq!(
        write_error(3.0, &[(0.0, 2.0, few), (1.0, 2.0, &mip)]),
        message("its segments have different filters")
    );
    let mip = Contents { plate_filter: PixelFilter::Mip, ..plate.clone() };
    let error = write_error(4.0, &[(0.0, 2.0, plate), (2.0, 2.0, &mip)]);
    assert_eq!(error, message("its plates have different filters"));
    let error = write_error(4.0, &[(0.0, 2.5, plate), (1.0, 1.0, few), (2.0, 2.0, plate)]);
    assert_eq!(error, message("two segments have a plate at 2 s"));
    let entries = [(0.0, 2.0), (2.0, 2.0)].map(|(start_s, duration_s)| SegmentPackage {
        start_s,
        duration_s,
        level: 0,
        contents: plate,
    });
    assert!(encode_take_head(&info(), 4.0, &entries).is_ok(), "one plate after the other");
    let bad = ClipInfo { fps: 0.0, ..info() };
    assert!(matches!(
        encode_take_head(&bad, 4.0, &entries),
        Err(EncodeError::Info { field: "frames per second", .. })
    ));
}

/// The error of reading a take whose parts are `change`d.
fn read_error(change: impl FnOnce(&mut TakeParts)) -> String {
    let mut parts = TakeParts::new(&small_take(Coder::Fixed)).unwrap();
    change(&mut parts);
    package(&parts.join_as_they_are(), &Limits::default()).unwrap_err().to_string()
}

#[test]
fn tables_that_break_a_rule_are_refused_at_their_entry() {
    let parts = TakeParts::new(&small_take(Coder::Fixed)).unwrap();
    let [first, second, third, end] = [0, 1, 2, 3].map(|i| parts.entry_at(i));
    let put_f64 = |entry: &mut [u8], at: usize, x: f64| entry[at..at + 8].copy_from_slice(&x.to_le_bytes());
    assert_eq!(read_error(|p| put_f64(&mut p.head, 76, 3.6)), "bad exact duration: 3.6, at byte 76");
    assert_eq!(read_error(|p| put_f64(&mut p.head, 76, f64::NAN)), "bad exact duration: NaN, at byte 76");
    // The nearest f64 that rounds to the same f32 is as good.
    let exact = 3.5f64.next_up();
    let mut near = parts.clone();
    put_f64(&mut near.head, 76, exact);
    assert_eq!(take_of(&near.join()).duration_s, exact);

    for (at, number) in
        [(0, f64::NAN), (0, 3.5), (0, -2.0), (8, 0.0), (8, -1.0), (8, f64::INFINITY), (8, f64::NAN)]
    {
        let error = read_error(|p| put_f64(&mut p.entries[1], at, number));
        assert!(error.starts_with("bad span of a segment (start, duration): "), "{error}");
        assert!(error.ends_with(&format!(", at byte {second}")), "{error}");
    }
    assert_eq!(read_error(|p| p.entries[1][17] = 2), format!("head is too short, at byte {end}"));
    assert_eq!(
        read_error(|p| p.entries[2][18] = 1),
        format!("bad reserved bytes: 1, at byte {}", third + 18)
    );
    let none = |p: &mut TakeParts| {
        p.entries[1][17] = 0;
        p.entries[1].truncate(24);
    };
    assert_eq!(read_error(none), format!("bad number of layers: 0, at byte {second}"));
    let many = |p: &mut TakeParts| {
        let rising = (1..17u32).flat_map(|k| [200 + k, k]).flat_map(u32::to_le_bytes);
        p.entries[1][17] = 17;
        p.entries[1].truncate(24);
        p.entries[1].extend(rising.chain([0, 2, 0, 0, 99, 0, 0, 0]));
    };
    assert_eq!(read_error(many), format!("bad number of layers: 17, at byte {second}"));
    for (at, number) in [(24, 76), (24, 1 << 20), (28, 0), (28, 6), (36, 3)] {
        let error = read_error(|p| put_u32(&mut p.entries[0], at, number));
        assert!(error.starts_with("bad layer of a segment: SegmentLayer"), "{error}");
        assert!(error.ends_with(&format!(", at byte {first}")), "{error}");
    }
    let swapped = read_error(|p| p.entries.swap(1, 2));
    let entry = second + parts.entries[2].len();
    assert_eq!(swapped, format!("bad order of segments: (0.0, 2.0), at byte {entry}"));
    let not_first = read_error(|p| p.entries.swap(0, 1));
    let entry = first + parts.entries[1].len();
    assert_eq!(not_first, format!("bad order of segments: (0.0, 3.5), at byte {entry}"));
    let many = |p: &mut TakeParts| {
        let entry = p.entries[2].clone();
        p.entries.extend(vec![entry; 30]);
    };
    let entry = third + 30 * parts.entries[2].len();
    let expected = format!("bad number of segments that hold one instant: 33, at byte {entry}");
    assert_eq!(read_error(many), expected);
    assert_eq!(read_error(|p| p.entries.clear()), "bad number of segments: 0, at byte 72");
    let mut bytes = small_take(Coder::Fixed);
    let body = u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize - 4;
    for (count, message) in
        [(2, "extra bytes after head"), (4, "bad number of segments"), (70_000, "bad number of segments")]
    {
        put_u32(&mut bytes, 72, count);
        let crc = crc32fast::hash(&bytes[..body]);
        put_u32(&mut bytes, body, crc as usize);
        let error = package(&bytes, &Limits::default()).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
    let mut extra = small_take(Coder::Fixed);
    let end = extra.len();
    extra.push(0);
    let error = package(&extra, &Limits::default()).unwrap_err().to_string();
    assert_eq!(error, format!("1 extra bytes after the last segment, at byte {end}"));
}

#[test]
fn a_segment_in_place_of_another_is_refused() {
    for coder in Coder::ALL {
        // Two segments of the same length, counts and columns.
        let shape = Shape { sh_degree: 0, ..Shape::full(6) };
        let field = field(shape, 1);
        let [a, b] = [1.0, 2.0].map(|duration| segment(coder, &field, None, duration));
        assert_eq!(a.len(), b.len());
        let bytes = take_package(3.0, &[(0.0, 1.0, 0, a), (1.0, 2.0, 0, b)]);
        let take = take_of(&bytes);
        let [first, second] = [0, 1].map(|index| bytes_of(&bytes, &take.segments[index]));
        for (index, bytes) in [(0, second), (1, first)] {
            let error = decode_segment(&take, index, bytes).unwrap_err();
            assert!(
                matches!(&error, Error::Format { error: FormatError::Segment { segment, .. }, .. } if *segment == index)
            );
            let message = error.to_string();
            assert!(
                message.starts_with(&format!(
                    "segment {index} is not the one in the table: a head with CRC-32 "
                ))
            );
        }
        assert!(decode_segment(&take, 0, first).is_ok() && decode_segment(&take, 1, second).is_ok());
    }
}

#[test]
fn a_segment_that_contradicts_the_head_of_the_take_is_refused() {
    let mip = |field: Field| Field { filter: PixelFilter::Mip, ..field };
    let coder = Coder::Fixed;
    let parts = TakeParts::new(&small_take(coder)).unwrap();
    let plate = |plate: Field| segment(coder, &static_field(4, 0, 1), Some(&plate), 3.5);
    for (index, package, expected) in [
        (
            1,
            segment(Coder::Rans, &field(Shape::full(4), 1), None, 2.0),
            "coder fixed expected, coder rans found, at byte 60",
        ),
        (1, segment(coder, &field(Shape::full(4), 1), None, 2.0), "at most PackageColumns"),
        (
            1,
            segment(coder, &mip(static_field(4, 0, 1)), None, 2.0),
            "filters blur, blur expected, filters mip, blur found, at byte 63",
        ),
        (
            0,
            plate(mip(static_field(2, 0, 1))),
            "filters blur, blur expected, filters blur, mip found, at byte 63",
        ),
        (0, plate(static_field(2, 1, 1)), "at most PackageColumns"),
        (
            0,
            plate(static_field(3, 0, 1)),
            "at most a plate of 2 Gaussians expected, a plate of 3 Gaussians found, at byte 68",
        ),
        (1, segment(coder, &static_field(3, 0, 1), None, 2.0), "SegmentLayer"),
    ] {
        let mut parts = parts.clone();
        parts.segments[index] = package;
        let bytes = parts.join();
        let take = take_of(&bytes);
        let entry = &take.segments[index];
        let error = decode_segment(&take, index, bytes_of(&bytes, entry)).unwrap_err();
        let (message, offset) = match &error {
            Error::Format { offset, error } => (error.to_string(), offset - entry.offset as usize),
            _ => panic!("{error}"),
        };
        let message = format!("{message}, at byte {offset}");
        assert!(message.starts_with(&format!("segment {index} is not the one in the table: ")), "{message}");
        assert!(message.contains(expected), "{message}");
    }
    // The prefixes of the table, one by one.
    for at in [24, 28, 32, 36] {
        let mut parts = parts.clone();
        let number = u32::from_le_bytes(parts.entries[0][at..at + 4].try_into().unwrap()) as usize;
        put_u32(&mut parts.entries[0], at, number + 1);
        if at == 32 {
            parts.segments[0].push(0);
        }
        let bytes = parts.join_as_they_are();
        let take = take_of(&bytes);
        let error = decode_segment(&take, 0, bytes_of(&bytes, &take.segments[0])).unwrap_err();
        let expected = if at == 32 { "1 extra bytes after the last section" } else { "SegmentLayer" };
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn errors_of_segments_count_from_the_start_of_the_take() {
    for coder in Coder::ALL {
        let bytes = small_take(coder);
        let take = take_of(&bytes);
        for (index, entry) in take.segments.iter().enumerate() {
            let alone = bytes_of(&bytes, entry);
            let mut damaged = alone.to_vec();
            *damaged.last_mut().unwrap() ^= 1;
            let expected = decode(&damaged, &Limits::default()).unwrap_err();
            let Error::Format { offset, error } = expected else { panic!("{expected}") };
            let expected = Error::Format { offset: offset + entry.offset as usize, error };
            assert_eq!(decode_segment(&take, index, &damaged).unwrap_err(), expected);
            let limits = Limits { max_gaussians: 1, ..Limits::default() };
            let expected = decode(alone, &limits).unwrap_err();
            let Error::Limits { offset, .. } = expected else { panic!("{expected}") };
            match take.decode_segment(index, alone, &limits, ONE).unwrap_err() {
                Error::Limits { offset: found, .. } => assert_eq!(found, offset + entry.offset as usize),
                error => panic!("{error}"),
            }
            for length in [0, 1, entry.layers[0].bytes - 1] {
                let truncated = FormatError::Truncated { needed: entry.layers[0].bytes, available: length };
                let expected = Error::Format { offset: entry.offset as usize + length, error: truncated };
                assert_eq!(decode_segment(&take, index, &alone[..length]).unwrap_err(), expected);
            }
        }
        // A segment of a version that does not exist yet.
        let mut parts = TakeParts::new(&bytes).unwrap();
        parts.segments[1][4] = 9;
        let bytes = parts.join();
        let take = take_of(&bytes);
        let entry = &take.segments[1];
        let error = decode_segment(&take, 1, bytes_of(&bytes, entry)).unwrap_err().to_string();
        assert_eq!(error, format!("bad major version: 9, at byte {}", entry.offset + 4));
    }
}

/// An hour of segments that begin every second, and of higher levels, of three layers each: the numbers of
/// FORMAT.md.
#[test]
fn the_table_of_an_hour_is_small() {
    let bytes = segment_package(&static_field(30, 0, 1), None, &options(Coder::Fixed, &[10, 20]), 2.0);
    let head = contents_of(&bytes);
    let mut spans = vec![(0.0, 3600.0)];
    let mut step = 1800.0;
    while spans.len() < 4000 {
        let count = (3600.0 / step) as u32;
        spans.extend((0..count.min(4000 - spans.len() as u32)).map(|k| (f64::from(k) * step, 2.0 * step)));
        step = if step > 2.0 { step / 2.0 } else { 1.0 };
    }
    let order = take_order(3600.0, &spans);
    let entry = |number: usize| SegmentPackage {
        start_s: spans[number].0,
        duration_s: spans[number].1,
        level: 0,
        contents: &head,
    };
    let entries: Vec<_> = order.into_iter().map(entry).collect();
    assert_eq!(entries.len(), 4000);
    let take = encode_take_head(&info(), 3600.0, &entries).unwrap();
    assert_eq!(take.len(), 84 + 2 * 29 + "frontprès".len() + 4000 * 48 + 4);
    assert!(take.len() < 250_000);
    assert_eq!(take_of(&take).segments.len(), 4000);
}

/// A take of one segment is 112 bytes longer than the clip, and 8 for each of its layers: FORMAT.md says so.
#[test]
fn a_take_of_one_segment_costs_little_more_than_its_clip() {
    for layers in 1..=16 {
        let ends: Vec<usize> = (1..layers).collect();
        let package = segment_package(&static_field(40, 0, 1), None, &options(Coder::Fixed, &ends), 2.0);
        let clip = common::package(&static_field(40, 0, 1), None, &options(Coder::Fixed, &ends));
        let take = take_package(2.0, &[(0.0, 2.0, 0, package)]);
        assert_eq!(take.len() - clip.len(), 112 + 8 * layers);
    }
}
