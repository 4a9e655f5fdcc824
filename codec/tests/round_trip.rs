//! Fields round-trip through packages of both coders: every combination of columns, within the error
//! bounds of FORMAT.md for the coder `fixed` and the requested precision for the coder `rans`.
//! With debug assertions the encoder of `rans` also asserts that the decoder returns the rows it
//! computed, bit for bit.

mod common;

use std::num::NonZero;

use codec::{
    ALPHA_MIN, Clip, ClipInfo, Coder, EncodeError, EncodeOptions, Field, LayerEnd, Limits, PixelFilter,
    Rounded, Source, Temporal, TimeIndex, contents, decode, encode, encode_rounded,
};
use common::{
    Parts, Shape, field, info, options, package,
    precision::{self, Worst},
    source_row, static_field, valid_clip,
};

/// Options under which every number of a field of at most 255 rows has a small known error.
fn exact(coder: Coder, field: &Field, layers: &[usize]) -> EncodeOptions {
    precision::uniform(coder, field, 80.0, layers)
}

fn fixed_clip(field: &Field, plate: Option<&Field>, layers: &[usize]) -> Clip {
    valid_clip(&package(field, plate, &options(Coder::Fixed, layers)))
}

/// Checks `actual` against `expected` to within `tolerance`.
#[track_caller]
fn near(column: &str, row: usize, actual: &[f32], expected: &[f32], tolerance: f32) {
    for (a, e) in actual.iter().zip(expected) {
        assert!((a - e).abs() <= tolerance, "{column} of row {row}: {a}, {e} +- {tolerance} expected");
    }
}

/// Largest magnitude in a column.
fn largest<'a>(column: impl IntoIterator<Item = &'a f32>) -> f32 {
    column.into_iter().fold(0.0, |largest, x| largest.max(x.abs()))
}

/// Checks the static columns of one chunk of the coder `fixed` against its source.
fn check_static_columns(decoded: &Field, source: &Field) {
    // Rounding of f32 arithmetic on numbers below 10.
    let slack = 4e-6;
    let size = 2.0 * largest(source.centers.iter().flatten());
    let log_span = 2.0 * largest(source.log_scales.iter().flatten());
    for i in 0..decoded.len() {
        let row = source_row(decoded, i);
        assert_eq!(decoded.opacities[i], source.opacities[row], "opacity of row {row}");
        near("centre", row, &decoded.centers[i], &source.centers[row], size / 4096.0 + slack);
        let half_step = 0.5 * log_span / 255.0 + slack;
        near("log-scale", row, &decoded.log_scales[i], &source.log_scales[row], half_step);
        let (q, r) = (decoded.rotations[i], source.rotations[row]);
        let dot: f32 = (0..4).map(|k| q[k] * r[k]).sum();
        // Half a step of 1/127 of the largest component in the three others.
        let angle = 2.0 * dot.abs().min(1.0).acos();
        assert!(angle <= 2.0 * 3f32.sqrt() * 0.5 / 127.0 + 1e-3, "rotation of row {row} is off by {angle}");
        let (decoded_sh, source_sh) = (decoded.sh_of(i), source.sh_of(row));
        near("colour", row, &decoded_sh[0], &source_sh[0], 0.5 * 3.4 / 255.0 + slack);
        for (k, (a, e)) in decoded_sh.iter().zip(source_sh).enumerate().skip(1) {
            // The first coefficient of a band is the largest: 0.5 / 1, 0.5 / 4, 0.5 / 9.
            let size = [0.5, 0.5 / 4.0, 0.5 / 9.0][(k >= 4) as usize + (k >= 9) as usize];
            near("coefficient", row, a, e, (0.5 * size / 127.0f32).max(0.5 / 1024.0) + slack);
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

/// Source rows of all rows from `start` to `end`, sorted.
fn source_rows(clip: &Clip, start: LayerEnd, end: LayerEnd) -> Vec<usize> {
    let fixed = (start.static_count..end.static_count).map(|i| source_row(&clip.static_field, i));
    let dynamic = (start.dynamic_count..end.dynamic_count).map(|i| source_row(&clip.dynamic_field, i));
    let mut rows: Vec<usize> = fixed.chain(dynamic).collect();
    rows.sort_unstable();
    rows
}

#[test]
fn every_combination_of_columns_round_trips() {
    let flags = [(false, false), (false, true), (true, false), (true, true)];
    for (sh_degree, motion_order) in (0..=3).flat_map(|degree| (0..=3).map(move |order| (degree, order))) {
        for ((rotation_rates, some_static), coder) in
            flags.into_iter().flat_map(|f| Coder::ALL.map(|c| (f, c)))
        {
            let shape = Shape { rows: 250, sh_degree, motion_order, rotation_rates, some_static };
            let source = field(shape, 1);
            let clip = valid_clip(&package(&source, None, &exact(coder, &source, &[])));
            let (fixed, dynamic) = (&clip.static_field, &clip.dynamic_field);
            assert_eq!(clip.len(), 250, "{shape:?}");
            assert_eq!(fixed.len(), if some_static { 62 } else { 0 }, "{shape:?}");
            assert_eq!([clip.sh_degree(), fixed.sh_degree, dynamic.sh_degree], [sh_degree; 3], "{shape:?}");
            assert_eq!(dynamic.motion_order(), motion_order, "{shape:?}");
            let temporal = dynamic.temporal.as_ref().unwrap();
            assert_eq!(temporal.rotation_rates.is_some(), rotation_rates, "{shape:?}");
            assert!(fixed.temporal.is_none() && clip.plate.is_none());
            assert_eq!(clip.info, info());
            match coder {
                Coder::Fixed => {
                    check_static_columns(fixed, &source);
                    check_static_columns(dynamic, &source);
                    check_temporal_columns(dynamic, &source);
                }
                Coder::Rans => Worst::measure(&[fixed, dynamic], &source).check(1e-3),
            }
            let rows = source_rows(&clip, LayerEnd::default(), clip.layers[0]);
            assert!(rows.into_iter().eq(0..250), "{shape:?}: every row once");
        }
    }
}

#[test]
fn a_plate_round_trips_and_an_empty_one_is_none() {
    let source = field(Shape::full(50), 3);
    for (coder, sh_degree) in Coder::ALL.into_iter().flat_map(|coder| (0..=3).map(move |d| (coder, d))) {
        let plate = static_field(250, sh_degree, 4);
        let mut options = options(coder, &[10]);
        options.precision.psnr = 150.0;
        let with_plate = valid_clip(&package(&source, Some(&plate), &options));
        let decoded = with_plate.plate.as_ref().unwrap();
        assert_eq!((decoded.len(), decoded.sh_degree), (250, sh_degree));
        match coder {
            Coder::Fixed => check_static_columns(decoded, &plate),
            // Detail below the footprint is lost.
            Coder::Rans => Worst::measure(&[decoded], &plate).check(0.05),
        }
        let without = valid_clip(&package(&source, None, &options));
        assert_eq!(Clip { plate: None, ..with_plate }, without, "a plate changes nothing else");
        assert_eq!(valid_clip(&package(&source, Some(&Field::default()), &options)).plate, None);
    }
}

#[test]
fn layers_hold_the_most_important_rows_first() {
    let source = field(Shape::full(200), 5);
    for coder in Coder::ALL {
        let clip = valid_clip(&package(&source, None, &exact(coder, &source, &[10, 60, 100])));
        assert_eq!(clip.layers.len(), 4);
        let mut start = LayerEnd::default();
        for (end, total) in clip.layers.iter().zip([10, 60, 100, 200]) {
            assert_eq!(end.total(), total);
            assert!(source_rows(&clip, start, *end).into_iter().eq(start.total()..total));
            start = *end;
        }
    }
}

/// The encoder's own decoded field is the decoded package, row by row of the source.
#[test]
fn rounded_rows_are_the_decoded_ones_in_the_order_of_the_source() {
    let threads = NonZero::new(2).unwrap();
    for coder in Coder::ALL {
        for (some_static, rotation_rates) in [(true, true), (true, false), (false, true)] {
            let shape = Shape { some_static, rotation_rates, ..Shape::full(255) };
            let field = field(shape, 5);
            let plate = self::field(Shape { rows: 40, motion_order: 0, ..shape }, 6);
            let plate = Field { temporal: None, ..plate };
            let info = ClipInfo::default();
            let source = Source { info: &info, field: &field, plate: Some(&plate) };
            let options = exact(coder, &field, &[30, 100]);
            let Rounded { package, field: rounded, forms } =
                encode_rounded(&source, &options, None, threads).unwrap();
            assert!(package == encode(&source, &options).unwrap());
            // Chunks that take over their forms are the same.
            let again = encode_rounded(&source, &options, Some(&forms), threads).unwrap();
            assert!(again.package == package && again.forms == forms);
            assert!(rounded.check().is_ok() && rounded != field);
            let clip = decode(&package, &Limits::default()).unwrap();
            let regions = [&clip.static_field, &clip.dynamic_field];
            assert_eq!(regions.map(Field::is_empty), [!some_static, false]);
            for region in regions {
                for row in 0..region.len() {
                    let i = source_row(region, row);
                    let mut expected = region.select(&[row]);
                    // A static Gaussian has its source's columns.
                    expected.temporal = expected.temporal.or_else(|| {
                        let temporal = field.select(&[i]).temporal.unwrap();
                        let zeros = temporal.motion.iter().map(|_| [0.0; 3]).collect();
                        let rates = temporal.rotation_rates.map(|rates| vec![[0.0; 4]; rates.len()]);
                        let s = vec![f32::INFINITY];
                        Some(Temporal { tau: vec![0.5], s, motion: zeros, rotation_rates: rates, ..temporal })
                    });
                    assert_eq!(rounded.select(&[i]), expected, "{coder:?}, row {i}");
                }
            }
        }
    }
}

#[test]
fn layers_at_or_above_the_size_collapse() {
    let source = field(Shape::full(30), 6);
    let package = |layers| package(&source, None, &options(Coder::Fixed, layers));
    for layers in [&[30][..], &[31], &[30, 40], &[100, 200, 300]] {
        assert_eq!(package(layers), package(&[]), "{layers:?}");
    }
    assert_eq!(package(&[10, 30, 40]), package(&[10]));
}

#[test]
fn a_field_of_several_chunks_round_trips() {
    let source = field(Shape::full(3 * 4096 + 5), 7);
    let clip = fixed_clip(&source, None, &[4097]);
    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (3073, 9220));
    let sum = |centers: &[[f32; 3]]| centers.iter().flatten().map(|x| f64::from(*x)).sum::<f64>();
    let error = sum(&clip.static_field.centers) + sum(&clip.dynamic_field.centers) - sum(&source.centers);
    assert!(error.abs() < 0.5, "centres are off by {error} in sum");
}

#[test]
fn columns_of_zeros_are_left_out() {
    let shape = Shape { some_static: false, ..Shape::full(40) };
    let full = field(shape, 8);
    let columns = |field: &Field| {
        let head = contents(&package(field, None, &options(Coder::Fixed, &[])), &Limits::default()).unwrap();
        (head.sh_degree, head.motion_order, head.rotation_rates)
    };
    let mut zeroed = full.clone();
    for i in 0..zeroed.len() {
        // All but the constant and the linear bands, up to invisible numbers.
        zeroed.sh[i * 16 + 4..(i + 1) * 16].fill([1e-4; 3]);
        zeroed.temporal.as_mut().unwrap().motion[3 * i + 1..3 * i + 3].fill([1e-9; 3]);
    }
    zeroed.temporal.as_mut().unwrap().rotation_rates.as_mut().unwrap().fill([1e-5; 4]);
    assert_eq!(columns(&zeroed), (1, 1, false));
    assert_eq!(columns(&full), (3, 3, true));
}

#[test]
fn a_static_field_has_no_dynamic_rows() {
    let source = static_field(100, 1, 9);
    let clip = fixed_clip(&source, None, &[40]);
    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (100, 0));
    check_static_columns(&clip.static_field, &source);
    assert!(clip.dynamic_field.temporal.is_some());
    assert_eq!(clip.time_index.candidates(0.5, 2).count(), 0);
}

/// The plainest Gaussians with a window.
const PLAIN: Shape =
    Shape { rows: 1, sh_degree: 0, motion_order: 0, rotation_rates: false, some_static: false };

#[test]
fn a_window_that_hardly_dims_is_static() {
    // o z^2 / 2 <= 1 / 510 at the far end of the clip, z = 1 / s.
    let mut source = field(Shape { rows: 2, ..PLAIN }, 1);
    source.opacities = vec![1.0, 1.0];
    let temporal = source.temporal.as_mut().unwrap();
    temporal.tau = vec![0.0, 0.0];
    temporal.s = vec![16.1, 15.8];
    let clip = fixed_clip(&source, None, &[]);
    assert_eq!((clip.static_field.len(), clip.dynamic_field.len()), (1, 1));
    let worst = source.opacities[0] as f64 - source.opacity_at(0, 1.0);
    assert!(worst <= 0.5 / 255.0, "drawn as constant it is off by {worst}");
}

#[test]
fn any_motion_or_rotation_is_dynamic() {
    let mut source = field(Shape { some_static: false, ..Shape::full(60) }, 1);
    let temporal = source.temporal.as_mut().unwrap();
    temporal.s.fill(f32::INFINITY);
    temporal.motion.fill([0.0; 3]);
    temporal.motion[3 * 9 + 2][1] = 1e-3;
    let rates = temporal.rotation_rates.as_mut().unwrap();
    rates.fill([0.0; 4]);
    rates[8][2] = 1e-3;
    let clip = fixed_clip(&source, None, &[]);
    let no_static = LayerEnd { static_count: clip.static_field.len(), dynamic_count: 0 };
    assert_eq!(source_rows(&clip, no_static, clip.layers[0]), [8, 9]);
    check_static_columns(&clip.static_field, &source);
}

#[test]
fn degenerate_fields_round_trip() {
    for shape in [Shape::full(1), PLAIN] {
        let source = field(shape, 10);
        let clip = fixed_clip(&source, None, &[1, 2]);
        assert_eq!(clip.len(), 1);
        assert_eq!(clip.dynamic_field.centers, source.centers, "the origin of its chunk");
        check_static_columns(&clip.dynamic_field, &source);
    }
    let mut point = field(Shape { motion_order: 0, ..Shape::full(255) }, 11);
    point.centers.fill([1.5, -2.25, 1e-3]);
    point.log_scales.fill([-3.0; 3]);
    let clip = fixed_clip(&point, None, &[]);
    for decoded in [&clip.static_field, &clip.dynamic_field] {
        assert!(decoded.centers.iter().all(|c| *c == [1.5, -2.25, 1e-3]));
        assert!(decoded.log_scales.iter().all(|s| *s == [-3.0; 3]));
    }
    assert_eq!(clip.bounds, [[1.5, -2.25, 1e-3]; 2]);

    let mut invisible = field(Shape { some_static: false, ..Shape::full(100) }, 12);
    invisible.opacities.fill(0.0);
    let mut flash = field(Shape::full(300), 13);
    flash.temporal.as_mut().unwrap().tau.fill(0.25);
    flash.temporal.as_mut().unwrap().s.fill(1e-7);
    let mut flat = static_field(5000, 2, 14);
    flat.centers.iter_mut().for_each(|c| c[2] = 7.0);
    flat.rotations.fill([1.0, 0.0, 0.0, 0.0]);
    let singles = [field(Shape::full(1), 1), field(PLAIN, 2), static_field(1, 3, 3)];
    for source in singles.into_iter().chain([point, invisible, flash, flat]) {
        precision::each_psnr(&source, |clip| assert_eq!(clip.len(), source.len()));
    }
}

#[test]
fn gaussians_that_are_never_alive_stay_so() {
    let mut source = field(Shape { some_static: false, ..Shape::full(100) }, 12);
    let temporal = source.temporal.as_mut().unwrap();
    for i in 0..50 {
        temporal.tau[i] = if i % 2 == 0 { -3.0 } else { 60_000.0 };
        temporal.s[i] = 0.1;
    }
    source.opacities[60] = 0.0;
    // Below 1/255, but not in 8 bits.
    source.opacities[61] = 0.0038;
    for (coder, expected) in [(Coder::Fixed, 51), (Coder::Rans, 52)] {
        let clip = valid_clip(&package(&source, None, &options(coder, &[])));
        assert_eq!(clip.dynamic_field.len(), 100);
        let never = (0..100).filter(|&i| clip.dynamic_field.alive_interval(i).is_none()).count();
        match coder {
            Coder::Fixed => assert_eq!(never, expected),
            Coder::Rans => assert!(never >= expected, "{never}"),
        }
    }
}

#[test]
fn extreme_numbers_stay_finite_and_larger_ones_are_refused() {
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
    valid_clip(&package(&source, None, &options(Coder::Fixed, &[])));
    precision::each_psnr(&source, |_| {});
    source.centers[0][0] = 2e9;
    let refused = encode(&Source { info: &info(), field: &source, plate: None }, &EncodeOptions::default());
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
    let clip = fixed_clip(&source, None, &[]);
    let distance = |c: &[f32; 3]| {
        let nearest = source.centers.iter().map(|s| (0..3).map(|k| (s[k] - c[k]).abs()).fold(0.0, f32::max));
        nearest.fold(f32::INFINITY, f32::min)
    };
    let worst = clip.static_field.centers[..4096].iter().step_by(16).map(distance).fold(0.0, f32::max);
    assert!(worst <= 6.0 / 4096.0, "a centre of the first chunk is off by {worst}");
}

/// One number far beyond all others of its column.
#[test]
fn an_outlier_costs_the_other_rows_of_its_chunk_little() {
    let outlier = 249;
    type Change = fn(&mut Field);
    let worst = |change: Change| {
        let mut source = field(Shape { some_static: false, ..Shape::full(250) }, 24);
        let temporal = source.temporal.as_mut().unwrap();
        (temporal.tau[outlier], temporal.s[outlier]) = (0.5, 0.003);
        change(&mut source);
        let clip = fixed_clip(&source, None, &[]);
        let mut worst = Worst::default();
        for decoded in [&clip.static_field, &clip.dynamic_field] {
            for i in (0..decoded.len()).filter(|&i| source_row(decoded, i) != outlier) {
                worst.compare(decoded, i, &source, source_row(decoded, i));
            }
        }
        worst
    };
    let plain = worst(|_| ());
    let changes: [(&str, Change); 5] = [
        ("colour", |field| field.sh[249 * 16] = [130.0; 3]),
        ("harmonics", |field| field.sh[249 * 16 + 5] = [-60.0; 3]),
        ("motion", |field| field.temporal.as_mut().unwrap().motion[249 * 3] = [400.0; 3]),
        ("rate", |field| {
            let rates = field.temporal.as_mut().unwrap().rotation_rates.as_mut().unwrap();
            rates[249] = [0.0, 300.0, 0.0, 0.0];
        }),
        ("centre", |field| field.centers[249] = [2e4; 3]),
    ];
    for (what, change) in changes {
        let found = worst(change);
        let is_close = |found: f64, plain: f64| found < 4.0 * plain + 1e-3;
        assert!(
            is_close(found.position, plain.position)
                && is_close(found.color, plain.color)
                && is_close(found.covariance, plain.covariance),
            "{what}: {found:?} for {plain:?}"
        );
    }
}

#[test]
fn contents_match_the_decoded_clip() {
    let (source, plate) = (field(Shape::full(9000), 17), static_field(70, 2, 18));
    use codec::{Region::*, SectionKind::*};
    for coder in Coder::ALL {
        let bytes = package(&source, Some(&plate), &options(coder, &[5000]));
        let contents = contents(&bytes, &Limits::default()).unwrap();
        let clip = valid_clip(&bytes);
        assert_eq!(contents.layers, clip.layers);
        assert_eq!(contents.info, clip.info);
        assert_eq!(contents.bounds, clip.bounds);
        assert_eq!((contents.plate_len, contents.plate_sh_degree), (70, 2));
        assert_eq!(contents.coder, coder);
        let sections = contents.sections.iter().map(|s| (s.kind, s.layer, s.region, s.chunk));
        let expected = [
            (Gaussians, 0, Plate, 0),
            (Gaussians, 0, Static, 0),
            (TimeIndex, 0, Dynamic, 0),
            (Gaussians, 0, Dynamic, 0),
            (Gaussians, 1, Static, 0),
            (TimeIndex, 1, Dynamic, 0),
            (Gaussians, 1, Dynamic, 0),
        ];
        let has_index = coder == Coder::Fixed;
        assert!(sections.eq(expected.into_iter().filter(|section| has_index || section.0 == Gaussians)));
        assert!(has_index || contents.sections.iter().all(|s| s.raw_length == s.length));
        assert_eq!(contents.sections.last().unwrap().end(), bytes.len());
    }
}

#[test]
fn every_alive_row_is_a_candidate() {
    let source = field(Shape::full(6000), 19);
    for coder in Coder::ALL {
        let clip = valid_clip(&package(&source, None, &options(coder, &[1500, 3000])));
        let mut count = 0;
        for layers in 0..=3 {
            let rows = if layers == 0 { 0 } else { clip.layers[layers - 1].dynamic_count };
            for step in 0..=200 {
                let t = f64::from(step) / 200.0;
                let mut is_candidate = vec![false; clip.dynamic_field.len()];
                let mut end = 0;
                for range in clip.time_index.candidates(t, layers) {
                    assert!(range.start >= end, "ranges are ascending and disjoint");
                    end = range.end;
                    count += range.len();
                    is_candidate[range].fill(true);
                }
                assert!(end <= rows, "rows of the requested layers only");
                for i in (0..rows).filter(|&i| clip.dynamic_field.opacity_at(i, t) >= ALPHA_MIN) {
                    assert!(is_candidate[i], "row {i} is alive at {t}");
                }
            }
        }
        let rows: usize = clip.layers.iter().map(|end| end.dynamic_count).sum();
        assert!(count < 201 * rows * 9 / 10, "{count} candidates of {rows} rows");
    }
}

#[test]
fn invalid_sources_are_refused() {
    let good = field(Shape::full(10), 20);
    let refused = |field: &Field, plate: Option<&Field>, layers: &[usize]| {
        encode(&Source { info: &info(), field, plate }, &options(Coder::Fixed, layers)).unwrap_err()
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
    assert_eq!(fixed_clip(&many, None, &ends[..15]).layers.len(), 16);
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

#[test]
fn filters_are_flags_of_the_head() {
    for (coder, filter, plate_filter) in Coder::ALL.into_iter().flat_map(|coder| {
        PixelFilter::ALL.into_iter().flat_map(move |a| PixelFilter::ALL.map(|b| (coder, a, b)))
    }) {
        let source = Field { filter, ..field(Shape::full(40), 1) };
        let plate = Field { filter: plate_filter, ..static_field(5, 0, 2) };
        let bytes = package(&source, Some(&plate), &options(coder, &[20]));
        let clip = valid_clip(&bytes);
        assert_eq!([clip.static_field.filter, clip.dynamic_field.filter, clip.filter()], [filter; 3]);
        assert_eq!(clip.plate.as_ref().unwrap().filter, plate_filter);
        assert_eq!(clip.merged().filter, filter);
        let head = contents(&bytes, &Limits::default()).unwrap();
        assert_eq!((head.filter, head.plate_filter), (filter, plate_filter));
        assert_eq!(bytes[63] & 1, 1, "rotation rates are the same flag");
    }
}

#[test]
fn packages_say_that_a_device_computed_numbers() {
    for coder in Coder::ALL {
        let made = |by_device| {
            let options = EncodeOptions { by_device, ..options(coder, &[20]) };
            package(&field(Shape::full(40), 1), None, &options)
        };
        let [without, with] = [false, true].map(made);
        let [without, with] = [without, with].map(|bytes| {
            let head = contents(&bytes, &Limits::default()).unwrap();
            (head.by_device, valid_clip(&bytes).merged())
        });
        assert_eq!((without.0, with.0), (false, true), "{coder:?}");
        assert_eq!(without.1, with.1, "{coder:?}: the same numbers");
    }
}

#[test]
fn a_near_distance_is_stored_where_there_is_one() {
    for coder in Coder::ALL {
        let [field, plate] = [field(Shape::full(40), 1), static_field(5, 0, 2)];
        let made = |near: [f32; 2]| {
            let [field, plate] =
                [(&field, near[0]), (&plate, near[1])].map(|(field, near)| Field { near, ..field.clone() });
            package(&field, Some(&plate), &options(coder, &[20]))
        };
        // The number costs four bytes, and nothing where there is none.
        let head = |bytes: &[u8]| contents(bytes, &Limits::default()).unwrap();
        let without = made([0.0; 2]);
        assert_eq!((head(&without).near, without[63] & 16), (0.0, 0));
        assert_eq!(made([-0.0; 2]), without);
        for (near, expected) in [([0.55, 0.0], 0.55), ([0.0, 0.3], 0.3), ([0.55, 0.3], 0.55)] {
            let bytes = made(near);
            let head = head(&bytes);
            assert_eq!((head.near, bytes[63] & 16), (expected, 16), "{coder:?}");
            let clip = valid_clip(&bytes);
            let plate = clip.plate.as_ref().unwrap();
            let found = [clip.static_field.near, clip.dynamic_field.near, plate.near, clip.near()];
            assert_eq!((found, clip.merged().near), ([expected; 4], expected), "{coder:?}");
            assert_eq!(bytes.len(), without.len() + 4, "{coder:?}");
            let rest = head.decode_layers(&bytes, 1, &Limits::default(), NonZero::<usize>::MIN).unwrap();
            assert_eq!(rest.dynamic_field.near, expected, "{coder:?}");
        }
    }
}

#[test]
fn damaged_near_distances_are_refused() {
    let field = Field { near: 0.5, ..field(Shape::full(40), 1) };
    let parts = Parts::new(&package(&field, None, &options(Coder::Rans, &[])));
    let at = parts.head.len() - 4;
    assert_eq!(parts.head[at..], 0.5f32.to_le_bytes());
    for (near, found) in [(f32::NAN, "NaN"), (-0.5, "-0.5"), (0.0, "0.0"), (f32::INFINITY, "inf")] {
        let mut parts = parts.clone();
        parts.head[at..].copy_from_slice(&near.to_le_bytes());
        let error = decode(&parts.join(), &Limits::default()).unwrap_err().to_string();
        assert_eq!(error, format!("bad near distance: {found}, at byte {at}"));
    }
    for near in [f32::NAN, -0.5, f32::INFINITY] {
        let field = Field { near, ..field.clone() };
        let source = Source { info: &info(), field: &field, plate: None };
        let refused = encode(&source, &options(Coder::Rans, &[]));
        assert!(matches!(refused, Err(EncodeError::Field { part: "field", .. })), "{near}: {refused:?}");
    }
}

#[test]
fn flags_of_filters_are_refused_where_they_mean_nothing() {
    let field = Field { filter: PixelFilter::Mip, ..field(Shape::full(40), 1) };
    let parts = Parts::new(&package(&field, None, &options(Coder::Fixed, &[])));
    let refused = |flags: u8| {
        let mut parts = parts.clone();
        parts.head[63] = flags;
        decode(&parts.join(), &Limits::default()).map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(refused(3), Ok(()));
    for flags in [7, 35] {
        let message = refused(flags).unwrap_err();
        assert!(message.contains("byte 63") && message.contains("flags"), "{flags}: {message}");
    }
}

/// Merging the two regions of a clip gives one field in which static rows are static.
#[test]
fn merged_clip_has_both_regions() {
    let moving = Shape { rows: 7, sh_degree: 2, motion_order: 2, rotation_rates: true, some_static: false };
    let (static_field, dynamic_field) = (static_field(5, 0, 1), field(moving, 2));
    let clip = |static_field: &Field, dynamic_field: &Field| {
        let end = LayerEnd { static_count: static_field.len(), dynamic_count: dynamic_field.len() };
        Clip {
            info: info(),
            bounds: [[-9.0; 3], [9.0; 3]],
            static_field: static_field.clone(),
            dynamic_field: dynamic_field.clone(),
            layers: vec![end],
            layers_announced: vec![end],
            time_index: TimeIndex::default(),
            plate: None,
        }
    };
    let merged = clip(&static_field, &dynamic_field).merged();
    merged.check().expect("a valid field");
    for (row, (source, i)) in
        (0..5).map(|i| (&static_field, i)).chain((0..7).map(|i| (&dynamic_field, i))).enumerate()
    {
        for t in [0.0, 0.4, 1.0] {
            assert_eq!(merged.position_at(row, t), source.position_at(i, t));
            assert_eq!(merged.rotation_at(row, t), source.rotation_at(i, t));
            assert_eq!(merged.opacity_at(row, t), source.opacity_at(i, t));
        }
        let sh = source.sh_of(i);
        assert_eq!(&merged.sh_of(row)[..sh.len()], sh);
        assert!(merged.sh_of(row)[sh.len()..].iter().all(|c| *c == [0.0; 3]));
    }
    let empty = Field { temporal: Some(Temporal::default()), ..Field::default() };
    assert_eq!(clip(&static_field, &empty).merged(), static_field);
}
