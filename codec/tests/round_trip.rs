//! Fields that go through a package come back: every combination of columns, within the error
//! bounds of FORMAT.md.

mod common;

use codec::{Clip, Coder, EncodeError, EncodeOptions, Field, Limits, Source, contents, decode, encode};
use common::{Shape, field, info, static_field};

fn package(field: &Field, plate: Option<&Field>, layers: &[usize]) -> Vec<u8> {
    let info = info();
    let options = EncodeOptions { coder: Coder::Fixed, layers: layers.to_vec(), ..EncodeOptions::default() };
    encode(&Source { info: &info, field, plate }, &options).unwrap()
}

fn clip(field: &Field, plate: Option<&Field>, layers: &[usize]) -> Clip {
    let clip = decode(&package(field, plate, layers), &Limits::default()).unwrap();
    for decoded in [&clip.static_field, &clip.dynamic_field].into_iter().chain(&clip.plate) {
        decoded.check().unwrap();
    }
    clip
}

/// The row of the source, at most 255 long, that a decoded row came from.
fn source_row(decoded: &Field, i: usize) -> usize {
    (decoded.opacities[i] * 255.0).round() as usize - 1
}

/// Checks `actual` against `expected` give or take `tolerance`.
#[track_caller]
fn near(what: &str, row: usize, actual: &[f32], expected: &[f32], tolerance: f32) {
    for (a, e) in actual.iter().zip(expected) {
        assert!((a - e).abs() <= tolerance, "{what} of row {row}: {a}, {e} +- {tolerance} expected");
    }
}

/// Largest magnitude in a column.
fn largest<'a>(column: impl IntoIterator<Item = &'a f32>) -> f32 {
    column.into_iter().fold(0.0, |largest, x| largest.max(x.abs()))
}

/// Compares every number of the static columns of a decoded region of one chunk to its source.
fn check_static_columns(decoded: &Field, source: &Field) {
    // Rounding of f32 arithmetic on numbers below 10.
    let slack = 4e-6;
    let size = 2.0 * largest(source.centers.iter().flatten());
    let log_span = 2.0 * largest(source.log_scales.iter().flatten());
    for i in 0..decoded.len() {
        let row = source_row(decoded, i);
        assert_eq!(decoded.opacities[i], source.opacities[row], "opacity of row {row}");
        near("centre", row, &decoded.centers[i], &source.centers[row], size / 4096.0 + slack);
        near(
            "log-scale",
            row,
            &decoded.log_scales[i],
            &source.log_scales[row],
            0.5 * log_span / 255.0 + slack,
        );
        let (q, r) = (decoded.rotations[i], source.rotations[row]);
        let dot: f32 = (0..4).map(|k| q[k] * r[k]).sum();
        // Half a step of 1/127 of the largest component in the three others.
        let angle = 2.0 * dot.abs().min(1.0).acos();
        assert!(angle <= 2.0 * 3f32.sqrt() * 0.5 / 127.0 + 1e-3, "rotation of row {row} is off by {angle}");
        let (decoded_sh, source_sh) = (decoded.sh_of(i), source.sh_of(row));
        near("colour", row, &decoded_sh[0], &source_sh[0], 0.5 * 3.4 / 255.0 + slack);
        for (k, (a, e)) in decoded_sh.iter().zip(source_sh).enumerate().skip(1) {
            // The first coefficient of a band reaches farthest: 0.5 / 1, 0.5 / 4, 0.5 / 9.
            let reach = [0.5, 0.5 / 4.0, 0.5 / 9.0][(k >= 4) as usize + (k >= 9) as usize];
            near("coefficient", row, a, e, (0.5 * reach / 127.0f32).max(0.5 / 1024.0) + slack);
        }
    }
}

fn check_temporal_columns(decoded: &Field, source: &Field) {
    let (actual, expected) = (decoded.temporal.as_ref().unwrap(), source.temporal.as_ref().unwrap());
    for i in 0..decoded.len() {
        let row = source_row(decoded, i);
        near("tau", row, &[actual.tau[i]], &[expected.tau[row]], expected.tau[row].abs() / 2048.0 + 1e-7);
        near("s", row, &[actual.s[i]], &[expected.s[row]], expected.s[row] / 2048.0);
        for (power, (a, e)) in actual.motion_of(i).iter().zip(expected.motion_of(row)).enumerate() {
            near("motion", row, a, e, 0.5 * (0.5 / (power + 1) as f32) / 511.0 + 1e-6);
        }
        if let Some(rates) = &actual.rotation_rates {
            let source_rates = expected.rotation_rates.as_ref().unwrap()[row];
            let dot: f32 = (0..4).map(|k| decoded.rotations[i][k] * source.rotations[row][k]).sum();
            near("rate", row, &rates[i], &source_rates.map(|r| r * dot.signum()), 0.5 * 0.3 / 127.0 + 1e-6);
        }
    }
}

#[test]
fn every_combination_of_columns_round_trips() {
    for sh_degree in 0..=3 {
        for motion_order in 0..=3 {
            for (rotation_rates, some_still) in [(false, false), (false, true), (true, false), (true, true)] {
                let shape = Shape { rows: 250, sh_degree, motion_order, rotation_rates, some_still };
                let source = field(shape, 1);
                let clip = clip(&source, None, &[]);
                assert_eq!(clip.len(), 250, "{shape:?}");
                assert_eq!(clip.static_field.len(), if some_still { 62 } else { 0 }, "{shape:?}");
                assert_eq!(clip.sh_degree(), sh_degree, "{shape:?}");
                assert_eq!(
                    (clip.static_field.sh_degree, clip.dynamic_field.sh_degree),
                    (sh_degree, sh_degree)
                );
                assert_eq!(clip.dynamic_field.motion_order(), motion_order, "{shape:?}");
                let temporal = clip.dynamic_field.temporal.as_ref().unwrap();
                assert_eq!(temporal.rotation_rates.is_some(), rotation_rates, "{shape:?}");
                assert!(clip.static_field.temporal.is_none() && clip.plate.is_none());
                check_static_columns(&clip.static_field, &source);
                check_static_columns(&clip.dynamic_field, &source);
                check_temporal_columns(&clip.dynamic_field, &source);
                let mut rows: Vec<usize> = (0..clip.static_field.len())
                    .map(|i| source_row(&clip.static_field, i))
                    .chain((0..clip.dynamic_field.len()).map(|i| source_row(&clip.dynamic_field, i)))
                    .collect();
                rows.sort_unstable();
                assert!(rows.into_iter().eq(0..250), "{shape:?}: every row once");
            }
        }
    }
}

#[test]
fn metadata_comes_back_exactly() {
    let clip = clip(&field(Shape::full(20), 2), None, &[]);
    assert_eq!(clip.info, info());
}

#[test]
fn a_plate_comes_back_and_an_empty_one_is_none() {
    let source = field(Shape::full(50), 3);
    for sh_degree in 0..=3 {
        let plate = static_field(255, sh_degree, 4);
        let with_plate = clip(&source, Some(&plate), &[10]);
        let decoded = with_plate.plate.as_ref().unwrap();
        assert_eq!((decoded.len(), decoded.sh_degree), (255, sh_degree));
        check_static_columns(decoded, &plate);
        let without = clip(&source, None, &[10]);
        assert_eq!(Clip { plate: None, ..with_plate }, without, "a plate changes nothing else");
    }
    assert_eq!(clip(&source, Some(&Field::default()), &[]).plate, None);
}

#[test]
fn layers_hold_the_most_important_rows_first() {
    let source = field(Shape::full(200), 5);
    let clip = clip(&source, None, &[10, 60, 100]);
    assert_eq!(clip.layers.len(), 4);
    let mut start = codec::LayerEnd::default();
    for (end, last_row) in clip.layers.iter().zip([10, 60, 100, 200]) {
        assert_eq!(end.total(), last_row);
        let rows = (start.static_count..end.static_count).map(|i| source_row(&clip.static_field, i));
        let mut rows: Vec<_> = rows
            .chain((start.dynamic_count..end.dynamic_count).map(|i| source_row(&clip.dynamic_field, i)))
            .collect();
        rows.sort_unstable();
        assert!(rows.into_iter().eq(start.total()..last_row));
        start = *end;
    }
}

#[test]
fn layers_at_or_above_the_size_collapse() {
    let source = field(Shape::full(30), 6);
    for layers in [&[30][..], &[31], &[30, 40], &[100, 200, 300]] {
        assert_eq!(package(&source, None, layers), package(&source, None, &[]), "{layers:?}");
    }
    assert_eq!(package(&source, None, &[10, 30, 40]), package(&source, None, &[10]));
}

#[test]
fn a_field_of_several_chunks_comes_back_in_full() {
    let source = field(Shape::full(3 * 4096 + 5), 7);
    let clip = clip(&source, None, &[4097]);
    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (3073, 9220));
    let sum = |centers: &[[f32; 3]]| centers.iter().flatten().map(|x| f64::from(*x)).sum::<f64>();
    let error = sum(&clip.static_field.centers) + sum(&clip.dynamic_field.centers) - sum(&source.centers);
    assert!(error.abs() < 0.5, "centres are off by {error} in sum");
}

#[test]
fn columns_of_zeros_are_left_out() {
    let shape = Shape { some_still: false, ..Shape::full(40) };
    let full = field(shape, 8);
    let bytes = |field: &Field| contents(&package(field, None, &[]), &Limits::default()).unwrap();
    let mut zeroed = full.clone();
    for i in 0..zeroed.len() {
        // Zero all but the constant and the linear bands, up to what no eye can see.
        zeroed.sh[i * 16 + 4..(i + 1) * 16].fill([1e-4; 3]);
        zeroed.temporal.as_mut().unwrap().motion[3 * i + 1..3 * i + 3].fill([1e-9; 3]);
    }
    zeroed.temporal.as_mut().unwrap().rotation_rates.as_mut().unwrap().fill([1e-5; 4]);
    let contents = bytes(&zeroed);
    assert_eq!((contents.sh_degree, contents.motion_order, contents.rotation_rates), (1, 1, false));
    let contents = bytes(&full);
    assert_eq!((contents.sh_degree, contents.motion_order, contents.rotation_rates), (3, 3, true));
}

#[test]
fn a_static_field_has_no_moving_region() {
    let source = static_field(100, 1, 9);
    let clip = clip(&source, None, &[40]);
    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (100, 0));
    check_static_columns(&clip.static_field, &source);
    assert!(clip.dynamic_field.temporal.is_some());
    assert_eq!(clip.time_index.candidates(0.5, 2).count(), 0);
}

#[test]
fn a_window_that_hardly_dims_is_still() {
    // o z^2 / 2 <= 1 / 510 at the far end of the clip, z = 1 / s.
    let mut source =
        field(Shape { rows: 2, sh_degree: 0, motion_order: 0, rotation_rates: false, some_still: false }, 1);
    source.opacities = vec![1.0, 1.0];
    let temporal = source.temporal.as_mut().unwrap();
    temporal.tau = vec![0.0, 0.0];
    temporal.s = vec![16.1, 15.8];
    let clip = clip(&source, None, &[]);
    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (1, 1));
    let worst = source.opacities[0] as f64 - source.opacity_at(0, 1.0);
    assert!(worst <= 0.5 / 255.0, "drawn as constant it is off by {worst}");
}

#[test]
fn what_moves_or_turns_at_all_is_not_still() {
    let mut source = field(Shape { some_still: false, ..Shape::full(60) }, 1);
    let temporal = source.temporal.as_mut().unwrap();
    temporal.s.fill(f32::INFINITY);
    temporal.motion.fill([0.0; 3]);
    temporal.motion[3 * 9 + 2][1] = 1e-3;
    let rates = temporal.rotation_rates.as_mut().unwrap();
    rates.fill([0.0; 4]);
    rates[8][2] = 1e-3;
    let clip = clip(&source, None, &[]);
    let mut moving: Vec<usize> =
        (0..clip.dynamic_field.len()).map(|i| source_row(&clip.dynamic_field, i)).collect();
    moving.sort_unstable();
    assert_eq!(moving, [8, 9]);
    check_static_columns(&clip.static_field, &source);
}

#[test]
fn one_gaussian() {
    for shape in [
        Shape::full(1),
        Shape { rows: 1, sh_degree: 0, motion_order: 0, rotation_rates: false, some_still: false },
    ] {
        let source = field(shape, 10);
        let clip = clip(&source, None, &[1, 2]);
        assert_eq!(clip.len(), 1);
        assert_eq!(clip.dynamic_field.centers, source.centers, "the origin of its chunk");
        check_static_columns(&clip.dynamic_field, &source);
    }
}

#[test]
fn all_at_one_point() {
    let mut source = field(Shape { motion_order: 0, ..Shape::full(255) }, 11);
    source.centers.fill([1.5, -2.25, 1e-3]);
    source.log_scales.fill([-3.0; 3]);
    let clip = clip(&source, None, &[]);
    for decoded in [&clip.static_field, &clip.dynamic_field] {
        assert!(decoded.centers.iter().all(|c| *c == [1.5, -2.25, 1e-3]));
        assert!(decoded.log_scales.iter().all(|s| *s == [-3.0; 3]));
    }
    assert_eq!(clip.bounds, [[1.5, -2.25, 1e-3]; 2]);
}

#[test]
fn gaussians_that_are_never_alive_are_kept_and_never_candidates_for_drawing() {
    let mut source = field(Shape { some_still: false, ..Shape::full(100) }, 12);
    let temporal = source.temporal.as_mut().unwrap();
    for i in 0..50 {
        temporal.tau[i] = if i % 2 == 0 { -3.0 } else { 60_000.0 };
        temporal.s[i] = 0.1;
    }
    source.opacities[60] = 0.0;
    let clip = clip(&source, None, &[]);
    assert_eq!(clip.dynamic_field.len(), 100);
    let dead = (0..100).filter(|&i| clip.dynamic_field.alive_interval(i).is_none()).count();
    assert_eq!(dead, 51);
}

#[test]
fn extreme_numbers_stay_finite() {
    let mut source = field(Shape::full(40), 13);
    let temporal = source.temporal.as_mut().unwrap();
    source.centers[0] = [1e9, -1e9, 1e9];
    source.log_scales[1] = [-1e9, 1e9, 0.0];
    source.sh[2] = [1e9; 3];
    source.sh[40] = [-1e9; 3];
    temporal.motion[3] = [1e9; 3];
    temporal.tau[4] = f32::MAX;
    temporal.tau[5] = -f32::MAX;
    temporal.s[6] = f32::MAX;
    temporal.s[7] = f32::MIN_POSITIVE;
    temporal.rotation_rates.as_mut().unwrap()[8] = [1e9; 4];
    clip(&source, None, &[]);
    // The next larger numbers are refused.
    source.centers[0][0] = 2e9;
    let info = info();
    let refused = encode(&Source { info: &info, field: &source, plate: None }, &EncodeOptions::default());
    assert_eq!(
        refused.unwrap_err().to_string(),
        "the field cannot be packaged: column centers holds 2e9, beyond 1e9"
    );
}

#[test]
fn an_outlier_costs_precision_in_its_own_chunk_only() {
    let mut source = static_field(2 * 4096, 0, 14);
    // Sorted along the Morton curve, the outlier comes last.
    source.centers[100] = [1e6; 3];
    let clip = clip(&source, None, &[]);
    let distance = |c: &[f32; 3]| {
        let nearest = source.centers.iter().map(|s| (0..3).map(|k| (s[k] - c[k]).abs()).fold(0.0, f32::max));
        nearest.fold(f32::INFINITY, f32::min)
    };
    let worst = clip.static_field.centers[..4096].iter().step_by(16).map(distance).fold(0.0, f32::max);
    assert!(worst <= 6.0 / 4096.0, "a centre of the first chunk is off by {worst}");
}

#[test]
fn same_field_same_bytes() {
    let source = field(Shape::full(5000), 15);
    let plate = static_field(300, 2, 16);
    assert_eq!(package(&source, Some(&plate), &[1000]), package(&source.clone(), Some(&plate), &[1000]));
}

#[test]
fn contents_tell_what_decoding_finds() {
    let source = field(Shape::full(9000), 17);
    let plate = static_field(70, 2, 18);
    let bytes = package(&source, Some(&plate), &[5000]);
    let contents = contents(&bytes, &Limits::default()).unwrap();
    let clip = decode(&bytes, &Limits::default()).unwrap();
    assert_eq!(contents.layers, clip.layers);
    assert_eq!(contents.info, clip.info);
    assert_eq!(contents.bounds, clip.bounds);
    assert_eq!((contents.plate_len, contents.plate_sh_degree), (70, 2));
    assert_eq!(contents.coder.name(), "fixed");
    let described: Vec<_> = contents.sections.iter().map(|s| (s.kind, s.layer, s.region, s.chunk)).collect();
    use codec::{Region::*, SectionKind::*};
    assert_eq!(
        described,
        [
            (Gaussians, 0, Plate, 0),
            (Gaussians, 0, Static, 0),
            (TimeIndex, 0, Dynamic, 0),
            (Gaussians, 0, Dynamic, 0),
            (Gaussians, 1, Static, 0),
            (TimeIndex, 1, Dynamic, 0),
            (Gaussians, 1, Dynamic, 0),
        ]
    );
    assert_eq!(contents.sections.last().unwrap().end(), bytes.len());
}

#[test]
fn every_alive_row_is_a_candidate() {
    let clip = clip(&field(Shape::full(6000), 19), None, &[1500, 3000]);
    for layers in 0..=3 {
        let rows = if layers == 0 { 0 } else { clip.layers[layers - 1].dynamic_count };
        for step in 0..=200 {
            let t = f64::from(step) / 200.0;
            let mut is_candidate = vec![false; clip.dynamic_field.len()];
            let mut end = 0;
            for range in clip.time_index.candidates(t, layers) {
                assert!(range.start >= end, "ranges rise and are disjoint");
                end = range.end;
                is_candidate[range].fill(true);
            }
            assert!(end <= rows, "no row of a layer not asked for");
            for i in (0..rows).filter(|&i| clip.dynamic_field.opacity_at(i, t) >= codec::ALPHA_MIN) {
                assert!(is_candidate[i], "row {i} is alive at {t}");
            }
        }
    }
}

#[test]
fn what_cannot_be_packaged_is_refused() {
    let good = field(Shape::full(10), 20);
    let refused = |field: &Field, plate: Option<&Field>, layers: &[usize]| {
        let options = EncodeOptions { layers: layers.to_vec(), ..EncodeOptions::default() };
        encode(&Source { info: &info(), field, plate }, &options).unwrap_err()
    };
    assert_eq!(refused(&Field::default(), None, &[]), EncodeError::Empty);
    let mut bad = good.clone();
    bad.centers[3][1] = f32::NAN;
    assert_eq!(
        refused(&bad, None, &[]).to_string(),
        "the field cannot be packaged: column centers, row 3: value out of range"
    );
    assert!(refused(&good, Some(&bad), &[]).to_string().starts_with("the plate cannot be packaged"));
    assert!(refused(&good, Some(&good), &[]).to_string().contains("a plate is static"));
    for layers in [&[0][..], &[5, 5], &[6, 5], &[20, 15]] {
        assert_eq!(refused(&good, None, layers), EncodeError::Layers { layers: layers.to_vec() });
    }
    let many = field(Shape::full(100), 21);
    let ends: Vec<usize> = (1..=16).collect();
    assert_eq!(refused(&many, None, &ends), EncodeError::Layers { layers: ends.clone() });
    assert_eq!(clip(&many, None, &ends[..15]).layers.len(), 16);
}

#[test]
fn metadata_out_of_range_is_refused() {
    let field = field(Shape::full(4), 22);
    let refuse = |field_name: &str, change: &dyn Fn(&mut codec::ClipInfo)| {
        let mut info = info();
        change(&mut info);
        let source = Source { info: &info, field: &field, plate: None };
        match encode(&source, &EncodeOptions::default()) {
            Err(EncodeError::Info { field, .. }) => assert!(field.contains(field_name), "{field}"),
            other => panic!("{field_name}: {other:?}"),
        }
    };
    refuse("duration", &|info| info.duration_s = 0.0);
    refuse("duration", &|info| info.duration_s = f32::INFINITY);
    refuse("frames per second", &|info| info.fps = f32::NAN);
    refuse("up vector", &|info| info.up = [0.0, 2.0, 0.0]);
    refuse("metres per unit", &|info| info.metres_per_unit = -1.0);
    refuse("name", &|info| info.viewpoints[0].name = "é".repeat(32));
    refuse("name", &|info| info.viewpoints[0].name = "\u{1b}[2J".into());
    refuse("position", &|info| info.viewpoints[1].position[0] = f32::NAN);
    refuse("target", &|info| info.viewpoints[1].target[2] = f32::INFINITY);
    refuse("field of view", &|info| info.viewpoints[0].fov_y = 3.2);
    refuse("number of viewpoints", &|info| info.viewpoints = vec![info.viewpoints[0].clone(); 65]);
}
