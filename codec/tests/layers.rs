//! Layers that are decoded alone and appended: the clip is the same as decoded at once, and damage to a later layer leaves
//! it as it was.

mod common;

use std::num::NonZero;
use std::panic::{AssertUnwindSafe, catch_unwind};

use codec::{
    Clip, Coder, Contents, Error, Field, FormatError, Layers, Limits, PixelFilter, Section, SectionKind,
    Take, contents, decode,
};
use common::{Parts, Rng, Shape, field, options, package, segment_package, static_field, take_package};

const ONE: NonZero<usize> = NonZero::<usize>::MIN;

/// Packages of several layers: of both regions with and without a plate, of one region, of more than a chunk, and with
/// layers that lack a region.
fn packages(coder: Coder) -> Vec<Vec<u8>> {
    let plate = static_field(30, 1, 2);
    let lone = |some_static| Shape { some_static, ..Shape::full(60) };
    // Every fourth row is static: layers of one row have one region.
    let mut packages = vec![
        package(&field(Shape::full(90), 1), Some(&plate), &options(coder, &[20, 41, 77])),
        package(&field(Shape::full(90), 2), None, &options(coder, &[1, 2, 3, 4, 5, 6, 50])),
        package(&static_field(50, 2, 3), Some(&plate), &options(coder, &[9, 30])),
        package(&field(lone(false), 4), None, &options(coder, &[5, 6])),
    ];
    let few = Shape { sh_degree: 0, motion_order: 1, rotation_rates: false, ..Shape::full(9_000) };
    packages.push(package(&field(few, 5), Some(&plate), &options(coder, &[1_000, 4_500])));
    packages
}

fn whole(bytes: &[u8]) -> Clip {
    decode(bytes, &Limits::default()).unwrap()
}

fn head(bytes: &[u8]) -> Contents {
    contents(bytes, &Limits::default()).unwrap()
}

fn layers(head: &Contents, bytes: &[u8], first: usize) -> Result<Layers, Error> {
    head.decode_layers(bytes, first, &Limits::default(), ONE)
}

/// The clips of all prefixes that end with a layer, and their lengths.
fn prefixes(bytes: &[u8]) -> Vec<(usize, Clip)> {
    head(bytes).layer_bytes().into_iter().map(|length| (length, whole(&bytes[..length]))).collect()
}

/// Checks that two clips are equal, column by column, to say which one is not.
fn check_equal(found: &Clip, expected: &Clip, what: &str) {
    for (region, a, b) in [
        ("static", &found.static_field, &expected.static_field),
        ("dynamic", &found.dynamic_field, &expected.dynamic_field),
    ] {
        assert!(a.centers == b.centers, "{what}: {region} centres");
        assert!(a.rotations == b.rotations, "{what}: {region} rotations");
        assert!(a.log_scales == b.log_scales, "{what}: {region} scales");
        assert!(a.opacities == b.opacities, "{what}: {region} opacities");
        assert!(a.sh == b.sh, "{what}: {region} colours");
        assert!(a.temporal == b.temporal, "{what}: {region} windows and motion");
    }
    assert!(found.time_index == expected.time_index, "{what}: time index");
    assert_eq!(found.layers, expected.layers, "{what}");
    assert!(found == expected, "{what}");
}

#[test]
fn layers_appended_one_by_one_or_together_are_the_clip_decoded_at_once() {
    for coder in Coder::ALL {
        for (number, bytes) in packages(coder).iter().enumerate() {
            let (head, prefixes) = (head(bytes), prefixes(bytes));
            let counts: Vec<usize> = head.layers.iter().map(|end| end.total()).collect();
            assert!(counts.len() > 2, "package {number} has layers");
            for (first, (_, start)) in (1..).zip(&prefixes) {
                assert_eq!((start.layers.len(), &start.layers_announced), (first, &head.layers));
                // Further layers from a prefix of each length, and one more at a time.
                let mut grown = start.clone();
                for (length, expected) in &prefixes[first..] {
                    let what = format!("{coder:?}, package {number}, {first} layers and {length} bytes");
                    let mut clip = start.clone();
                    clip.append(layers(&head, &bytes[..*length], first).unwrap());
                    check_equal(&clip, expected, &what);
                    grown.append(layers(&head, &bytes[..*length], grown.layers.len()).unwrap());
                    check_equal(&grown, expected, &what);
                }
            }
        }
    }
}

#[test]
fn layers_have_the_rows_behind_those_before_and_no_others() {
    for coder in Coder::ALL {
        let bytes = &packages(coder)[0];
        let (head, all) = (head(bytes), whole(bytes));
        let further = layers(&head, bytes, 2).unwrap();
        assert_eq!((further.before, &further.ends[..]), (head.layers[1], &head.layers[2..]));
        let of_all = |field: &Field, from: usize| field.centers[from..].to_vec();
        assert_eq!(further.static_field.centers, of_all(&all.static_field, further.before.static_count));
        assert_eq!(further.dynamic_field.centers, of_all(&all.dynamic_field, further.before.dynamic_count));
        assert_eq!(further.time_index, all.time_index.since(2));
        assert_eq!(all.time_index.since(0), all.time_index);
        // Candidates equal the candidates of the whole clip, counted from the first row of these layers.
        let first = further.before.dynamic_count;
        for t in [0.0, 0.3, 1.0] {
            let of_first = all.time_index.candidates(t, 2).count();
            let of_all = all.time_index.candidates(t, 4).skip(of_first);
            let of_all: Vec<_> = of_all.map(|rows| rows.start - first..rows.end - first).collect();
            assert!(further.time_index.candidates(t, 2).eq(of_all), "at {t}");
        }
    }
}

#[test]
fn any_number_of_threads_decodes_the_same_layers() {
    for coder in Coder::ALL {
        let mut bytes = packages(coder).pop().unwrap();
        let head = head(&bytes);
        for _ in 0..2 {
            let decode =
                |threads| head.decode_layers(&bytes, 1, &Limits::default(), NonZero::new(threads).unwrap());
            let expected = decode(1);
            assert!([2, 3, 16].into_iter().all(|threads| decode(threads) == expected), "{coder:?}");
            let at = bytes.len() - 5;
            bytes[at] ^= 1;
        }
    }
}

/// The columns of a take that a segment lacks are zero in further layers, too.
#[test]
fn layers_of_segments_are_those_of_the_segment_decoded_at_once() {
    for coder in Coder::ALL {
        let few = Shape { motion_order: 1, rotation_rates: false, sh_degree: 0, ..Shape::full(70) };
        let narrow = segment_package(
            &field(few, 3),
            Some(&static_field(4, 0, 2)),
            &options(coder, &[20, 30, 55]),
            2.0,
        );
        let wide = segment_package(&field(Shape::full(40), 4), None, &options(coder, &[1, 20]), 1.0);
        let bytes = take_package(3.0, &[(0.0, 2.0, 0, narrow), (2.0, 1.0, 0, wide)]);
        let take = codec::package(&bytes, &Limits::default()).unwrap();
        for (index, segment) in take.segments.iter().enumerate() {
            let alone = &bytes[segment.offset as usize..][..segment.bytes()];
            let prefix = |layers: usize| &alone[..segment.layers[layers - 1].bytes];
            let decoded =
                |layers: usize| take.decode_segment(index, prefix(layers), &Limits::default(), ONE).unwrap();
            for first in 1..segment.layers.len() {
                let mut grown = decoded(first);
                for layers in first + 1..=segment.layers.len() {
                    let further = |first: usize| {
                        let limits = &Limits::default();
                        take.decode_segment_layers(index, prefix(layers), first, limits, ONE).unwrap()
                    };
                    let (mut clip, expected) = (decoded(first), decoded(layers));
                    clip.append(further(first));
                    check_equal(&clip, &expected, &format!("{coder:?}, {first} and {layers} layers"));
                    grown.append(further(grown.layers.len()));
                    check_equal(&grown, &expected, &format!("{coder:?}, to {layers} layers"));
                }
            }
            check_damage_of_segment(&take, index, alone);
        }
    }
}

/// Checks that damage to the last layer of a segment is an error with an offset in the take.
fn check_damage_of_segment(take: &Take, index: usize, alone: &[u8]) {
    let mut damaged = alone.to_vec();
    *damaged.last_mut().unwrap() ^= 1;
    let first = take.segments[index].layers.len() - 1;
    let error = decode(&damaged, &Limits::default()).unwrap_err();
    let Error::Format { offset, error } = error else { panic!("{error}") };
    let expected = Error::Format { offset: offset + take.segments[index].offset as usize, error };
    let found = take.decode_segment_layers(index, &damaged, first, &Limits::default(), ONE).unwrap_err();
    assert_eq!(found, expected);
    damaged[0] ^= 1;
    let found = take.decode_segment_layers(index, &damaged, first, &Limits::default(), ONE);
    assert!(found.is_err(), "the head counts, too");
}

#[test]
fn damage_to_a_later_layer_is_an_error_and_leaves_the_clip_as_it_was() {
    let mut rng = Rng(1);
    for coder in Coder::ALL {
        for bytes in &packages(coder)[..3] {
            let (head, prefixes) = (head(bytes), prefixes(bytes));
            for (first, (start, _)) in (1..head.layers.len()).zip(&prefixes) {
                // Cut anywhere in the layer: it is missing, as in a prefix.
                let end = prefixes[first].0;
                for length in [*start, start + 1, usize::midpoint(*start, end), end - 1] {
                    let truncated = FormatError::Truncated { needed: end, available: length };
                    let expected = Error::Format { offset: length, error: truncated };
                    assert_eq!(layers(&head, &bytes[..length], first).unwrap_err(), expected);
                }
                // Flipped: the same error as decoding all of it, with nothing of the layers before in it.
                for _ in 0..40 {
                    let mut damaged = bytes.clone();
                    damaged[start + rng.below(bytes.len() - start)] ^= 1 << rng.below(8);
                    let expected = decode(&damaged, &Limits::default()).unwrap_err();
                    assert_eq!(layers(&head, &damaged, first).unwrap_err(), expected);
                }
                let mut damaged = bytes.clone();
                damaged[start - 1] ^= 1;
                assert!(layers(&head, &damaged, first).is_ok(), "the layers before are not read again");
            }
            let mut longer = bytes.clone();
            longer.push(0);
            let expected = decode(&longer, &Limits::default()).unwrap_err();
            assert_eq!(layers(&head, &longer, 1).unwrap_err(), expected);
        }
    }
}

/// A time index that contradicts its rows names the row of the clip, not of the layer.
#[test]
fn the_time_index_of_a_later_layer_is_checked() {
    let mut parts = Parts::new(&packages(Coder::Fixed)[0]);
    let is_index = |section: &Section| section.kind == SectionKind::TimeIndex;
    let index = head(&parts.join()).sections.iter().rposition(is_index).unwrap();
    let cells = &mut parts.sections[index];
    // Each count is a byte. A row of the fullest cell moves to the last one.
    let fullest = (0..cells.len()).max_by_key(|cell| cells[*cell]).unwrap();
    cells[fullest] -= 1;
    *cells.last_mut().unwrap() += 1;
    let bytes = parts.join();
    let expected = decode(&bytes, &Limits::default()).unwrap_err();
    assert!(matches!(expected, Error::Format { error: FormatError::TimeIndex { .. }, .. }), "{expected}");
    assert_eq!(layers(&head(&bytes), &bytes, 3).unwrap_err(), expected);
}

#[test]
fn limits_bound_the_clip_with_the_layers_before() {
    for coder in Coder::ALL {
        let bytes = packages(coder).pop().unwrap();
        let head = head(&bytes);
        let last = head.layers.len() - 1;
        let decoded = |limits: &Limits| head.decode_layers(&bytes, last, limits, ONE);
        let total = whole(&bytes).len() + head.plate_len;
        let gaussians = |max_gaussians| decoded(&Limits { max_gaussians, ..Limits::default() });
        assert!(gaussians(total).is_ok());
        assert!(matches!(gaussians(total - 1), Err(Error::Limits { quantity: "Gaussians", .. })));
        let least = |decodes: &dyn Fn(&Limits) -> bool| {
            let (mut too_few, mut enough) = (0, 1 << 26);
            while enough - too_few > 1 << 12 {
                let max_bytes = usize::midpoint(too_few, enough);
                let fits = decodes(&Limits { max_bytes, ..Limits::default() });
                *(if fits { &mut enough } else { &mut too_few }) = max_bytes;
            }
            enough
        };
        // All that differs is the work space, for the largest layer of those that are decoded.
        let at_once = least(&|limits| decode(&bytes, limits).is_ok());
        let alone = least(&|limits| decoded(limits).is_ok());
        assert!(at_once.abs_diff(alone) < 32_000, "{alone} bytes alone, {at_once} at once");
    }
}

#[test]
fn layers_that_do_not_follow_are_refused() {
    let bytes = &packages(Coder::Fixed)[0];
    let other = &packages(Coder::Fixed)[1];
    let panics = |work: &mut dyn FnMut()| catch_unwind(AssertUnwindSafe(work)).is_err();
    let start = whole(&bytes[..head(bytes).layer_bytes()[1]]);
    for (package, first) in [(bytes, 1), (bytes, 3), (other, 2)] {
        let further = layers(&head(package), package, first).unwrap();
        let mut clip = start.clone();
        assert!(panics(&mut || clip.append(further.clone())), "layer {first}");
        assert!(clip == start, "it stays as it was");
    }
    let mut further = layers(&head(bytes), bytes, 2).unwrap();
    further.dynamic_field.filter = PixelFilter::Mip;
    let mut clip = start.clone();
    assert!(panics(&mut || clip.append(further.clone())) && clip == start, "other columns");
    for first in [0, 4] {
        assert!(panics(&mut || drop(layers(&head(bytes), bytes, first))), "layer {first}");
    }
}
