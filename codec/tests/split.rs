//! Splitting a field into the segments of a take: each Gaussian is in one segment that holds its life, and is there
//! what it is in the field, to within the rounding of its numbers to f32.

mod common;

use codec::{
    ALPHA_MIN, ClipInfo, Coder, Field, Limits, SegmentPackage, Source, SplitSegment, Temporal, contents,
    encode, encode_take_head, package, split,
};
use common::{Rng, Shape, field, info, options, static_field};

/// Duration of the take in seconds, and its unit.
const DURATION_S: f64 = 120.0;
const UNIT_S: f64 = 1.0;

/// Largest relative error of rounding to f32.
const HALF_ULP: f64 = 1.0 / (1u64 << 24) as f64;

/// Error of the f64 arithmetic of both sides, relative to the numbers it adds.
const F64_ERROR: f64 = 1e-13;

/// A field of many lifetimes, 0.1 s to 60 s, and of stiff ones: windows of a millionth of the take, longer than the
/// take and infinite; centres far outside it; Gaussians that are never alive; instants at which segments begin.
fn many_lifetimes(rows: usize) -> Field {
    let shape = Shape { sh_degree: 1, some_static: false, ..Shape::full(rows) };
    let mut field = field(shape, 7);
    let mut rng = Rng(8);
    let order = 3;
    let temporal = field.temporal.as_mut().unwrap();
    for i in 0..rows {
        // Life in clip time; the opacity below is at least 0.02.
        let life = 0.1 * 600f32.powf(rng.uniform(0.0, 1.0)) / DURATION_S as f32;
        field.opacities[i] = rng.uniform(0.02, 1.0);
        let radius = (2.0 * (255.0 * field.opacities[i]).ln()).sqrt();
        (temporal.tau[i], temporal.s[i]) = (rng.uniform(-0.05, 1.05), 0.5 * life / radius);
        match i % 40 {
            0 => temporal.s[i] = 1e-6,
            1 => temporal.s[i] = rng.uniform(1.5, 50.0),
            2 => temporal.s[i] = f32::INFINITY,
            // Alive in the take, though the centre is far from it.
            3 => (temporal.tau[i], temporal.s[i]) = (-2.0, rng.uniform(0.7, 0.9)),
            // Never alive.
            4 => (temporal.tau[i], temporal.s[i]) = (rng.uniform(-9.0, -1.0), 0.01),
            5 => field.opacities[i] = 0.003,
            6 => (temporal.tau[i], temporal.s[i]) = (f32::MAX, 1e37),
            7 => (temporal.tau[i], temporal.s[i]) = (f32::MIN, f32::MAX),
            // Where segments begin and end.
            8 => temporal.tau[i] = rng.below(121) as f32 / 120.0,
            9 => temporal.tau[i] = rng.below(2) as f32,
            _ => {}
        }
        // Motion and turns of the order of 1 within the life.
        for power in 0..order {
            let scale = 1.0 / life.powi(power as i32 + 1);
            temporal.motion[order * i + power] = rng.vector::<3>(0.5).map(|x| x * scale);
        }
        let rates = temporal.rotation_rates.as_mut().unwrap();
        rates[i] = rng.vector::<4>(0.5).map(|x| x / life);
        // Positions far from the take stay numbers.
        if matches!(i % 40, 6 | 7) {
            temporal.motion[order * i..order * (i + 1)].fill([0.0; 3]);
            rates[i] = [0.0; 4];
        }
    }
    field
}

/// Whether a segment is seen at a time.
fn holds(segment: &SplitSegment, duration_s: f64, t_s: f64) -> bool {
    let end_s = segment.start_s + segment.duration_s;
    segment.start_s <= t_s && (t_s < end_s || end_s >= duration_s && t_s <= end_s)
}

/// Checks that each row is in one segment, in ascending order, whose span holds its life.
fn check_places(field: &Field, duration_s: f64, segments: &[SplitSegment]) {
    let mut seen = vec![0; field.len()];
    for segment in segments {
        assert!(!segment.rows.is_empty() && segment.rows.is_sorted());
        assert_eq!(segment.field.check(), Ok(()));
        assert_eq!(segment.field.len(), segment.rows.len());
        assert!(segment.start_s >= 0.0 && segment.start_s < duration_s, "{}", segment.start_s);
        for &row in &segment.rows {
            seen[row] += 1;
            if let Some((birth, death)) = field.alive_interval(row) {
                let held = [birth, death].map(|t| holds(segment, duration_s, t * duration_s));
                assert_eq!(held, [true; 2], "row {row} lives from {birth} to {death}");
            }
        }
    }
    assert!(seen.iter().all(|count| *count == 1));
}

/// The largest differences that rounding tau, s, motion and rates to f32 makes, of position, opacity and rotation of a
/// row at a time, derived from the exact numbers in clip time of the segment.
struct Bound {
    position: [f64; 3],
    opacity: f64,
    rotation: f64,
}

impl Bound {
    fn new(field: &Field, row: usize, t: f64, segment: &SplitSegment) -> Bound {
        let Some(temporal) = &field.temporal else {
            return Bound { position: [0.0; 3], opacity: 0.0, rotation: 0.0 };
        };
        let scale = segment.duration_s / DURATION_S;
        let tau = (f64::from(temporal.tau[row]) * DURATION_S - segment.start_s) / segment.duration_s;
        let s = f64::from(temporal.s[row]) / scale;
        let distance = (t - f64::from(temporal.tau[row])).abs() / scale;
        // Of the distance to the rounded centre, and of clip time itself, at most 1.
        let slack = HALF_ULP * tau.abs() + F64_ERROR * (1.0 + distance + tau.abs());
        let coefficient = |x: f32, power: i32| f64::from(x).abs() * scale.powi(power);
        let position = std::array::from_fn(|axis| {
            let terms = temporal.motion_of(row).iter().zip(1..).map(|(v, power)| {
                let v = coefficient(v[axis], power);
                let exact = v * distance.powi(power);
                let most =
                    (v * (1.0 + HALF_ULP) + f64::from(f32::MIN_POSITIVE)) * (distance + slack).powi(power);
                most - exact + F64_ERROR * most
            });
            terms.sum::<f64>() + F64_ERROR * f64::from(field.centers[row][axis]).abs()
        });
        let window = |z: f64| f64::from(field.opacities[row]) * (-0.5 * z * z).exp();
        let nearest = window((distance - slack).max(0.0) / (s * (1.0 + HALF_ULP)));
        let farthest = window((distance + slack) / (s * (1.0 - HALF_ULP)));
        let exact = window(distance / s);
        let opacity = (nearest - exact).max(exact - farthest) + F64_ERROR;
        let rotation = temporal.rotation_rates.as_ref().map_or(0.0, |rates| {
            let square =
                |value: &dyn Fn(usize) -> f64| (0..4).map(|k| value(k) * value(k)).sum::<f64>().sqrt();
            let signed = (t - f64::from(temporal.tau[row])) / scale;
            let sum =
                square(&|k| f64::from(field.rotations[row][k]) + f64::from(rates[row][k]) * scale * signed);
            let off = square(&|k| {
                let rate = coefficient(rates[row][k], 1);
                rate * (1.0 + HALF_ULP) * (distance + slack) - rate * distance
                    + F64_ERROR * (1.0 + rate * distance)
            });
            // Normalising turns an error e of a sum of length n into at most 2 e / n.
            2.0 * off / sum
        });
        Bound { position, opacity, rotation }
    }
}

#[test]
fn a_field_of_many_lifetimes_is_the_union_of_its_segments() {
    let field = many_lifetimes(2_000);
    let segments = split(&field, DURATION_S, UNIT_S);
    check_places(&field, DURATION_S, &segments);
    assert!(segments.len() > 200, "{} segments", segments.len());
    let levels: Vec<usize> =
        (0..=6).map(|level| segments.iter().filter(|segment| segment.level == level).count()).collect();
    assert!(levels.iter().all(|count| *count > 0), "{levels:?}");

    let (mut compared, mut worst) = (0, [0.0; 3]);
    for step in 0..=10 * DURATION_S as u32 {
        let t_s = f64::from(step) / 10.0;
        let t = t_s / DURATION_S;
        let mut missing: Vec<bool> =
            (0..field.len()).map(|row| field.opacity_at(row, t) >= ALPHA_MIN).collect();
        for segment in segments.iter().filter(|segment| holds(segment, DURATION_S, t_s)) {
            let u = (t_s - segment.start_s) / segment.duration_s;
            for (i, &row) in segment.rows.iter().enumerate() {
                missing[row] = false;
                let bound = Bound::new(&field, row, t, segment);
                let (exact, split) = (field.position_at(row, t), segment.field.position_at(i, u));
                for axis in 0..3 {
                    let off = (exact[axis] - split[axis]).abs();
                    assert!(
                        off <= bound.position[axis],
                        "row {row} at {t_s} s: {off} > {:?}",
                        bound.position
                    );
                }
                let off = (field.opacity_at(row, t) - segment.field.opacity_at(i, u)).abs();
                assert!(
                    off <= bound.opacity,
                    "row {row} at {t_s} s: opacity off by {off}, {} allowed",
                    bound.opacity
                );
                let (exact, split) = (field.rotation_at(row, t), segment.field.rotation_at(i, u));
                let off = (0..4).map(|k| (exact[k] - split[k]).powi(2)).sum::<f64>().sqrt();
                assert!(
                    off <= bound.rotation,
                    "row {row} at {t_s} s: turned by {off}, {} allowed",
                    bound.rotation
                );
                // The bounds of what is seen, apart from windows of a tenth of a millisecond.
                if row % 40 > 9 && field.opacity_at(row, t) >= ALPHA_MIN {
                    worst[0] = bound.position.into_iter().fold(worst[0], f64::max);
                    worst[1] = bound.opacity.max(worst[1]);
                    worst[2] = bound.rotation.max(worst[2]);
                    compared += 1;
                }
            }
        }
        assert_eq!(missing.iter().position(|missing| *missing), None, "at {t_s} s");
    }
    println!("{compared} Gaussians compared; largest bounds of position, opacity, rotation: {worst:?}");
    assert!(compared > 100_000, "{compared}");
    assert!(worst[0] < 1e-4 && worst[1] < 1e-4, "the bounds are tight: {worst:?}");
}

/// The instants at which segments begin and end, and at which Gaussians are born and die, rounded to either side.
#[test]
fn nothing_alive_is_missing_at_the_edges() {
    for (duration_s, unit_s) in
        [(DURATION_S, UNIT_S), (118.3, 0.7), (7.0, 1.3), (3.0, 1.5), (0.3, 0.1), (1.0, 5.0)]
    {
        let field = many_lifetimes(400);
        let segments = split(&field, duration_s, unit_s);
        check_places(&field, duration_s, &segments);
        let edges =
            segments.iter().flat_map(|segment| [segment.start_s, segment.start_s + segment.duration_s]);
        let lives = (0..field.len()).filter_map(|row| field.alive_interval(row));
        let lives = lives.flat_map(|(birth, death)| [birth * duration_s, death * duration_s]);
        for t_s in edges.chain(lives).flat_map(|t| [t.next_down(), t, t.next_up()]) {
            let t_s = t_s.clamp(0.0, duration_s);
            let held: Vec<&SplitSegment> = segments.iter().filter(|s| holds(s, duration_s, t_s)).collect();
            for row in 0..field.len() {
                let Some((birth, death)) = field.alive_interval(row) else { continue };
                if (birth * duration_s..=death * duration_s).contains(&t_s) {
                    let is_held = held.iter().any(|segment| segment.rows.binary_search(&row).is_ok());
                    assert!(is_held, "row {row} at {t_s} of {duration_s} s");
                }
            }
        }
    }
}

#[test]
fn segments_lie_on_the_grid() {
    let window = |life_s: (f64, f64)| {
        // Opacity e^2 / 255 puts the ends at tau -+ 2 s.
        let opacity = (1f64.exp().powi(2) / 255.0) as f32;
        let (center, width) = (0.5 * (life_s.0 + life_s.1) / 16.0, 0.25 * (life_s.1 - life_s.0) / 16.0);
        (opacity, center as f32, width as f32)
    };
    let lives = [
        ((0.1, 1.9), (0.0, 2.0, 0)),
        ((0.9, 1.8), (0.0, 2.0, 0)),
        ((1.1, 2.9), (1.0, 2.0, 0)),
        ((0.9, 2.1), (0.0, 4.0, 1)),
        ((1.9, 4.1), (0.0, 8.0, 2)),
        ((2.1, 5.9), (2.0, 4.0, 1)),
        ((15.1, 15.9), (15.0, 1.0, 0)),
        ((13.1, 15.9), (12.0, 4.0, 1)),
        // Cut to the take.
        ((15.1, 19.0), (15.0, 1.0, 0)),
        ((-9.0, 0.5), (0.0, 2.0, 0)),
        ((-9.0, 2.5), (0.0, 4.0, 1)),
        ((7.9, 8.1), (7.0, 2.0, 0)),
        ((6.9, 9.1), (6.0, 4.0, 1)),
        ((5.9, 10.1), (4.0, 8.0, 2)),
        ((3.9, 12.1), (0.0, 16.0, 3)),
        ((-1.0, 20.0), (0.0, 16.0, 3)),
        // Never alive: at the instant in the take that is nearest to the window.
        ((-2.0, -1.0), (0.0, 2.0, 0)),
        ((17.0, 18.0), (15.0, 1.0, 0)),
    ];
    let windows = lives.map(|(life, _)| window(life));
    let field = Field {
        opacities: windows.map(|window| window.0).to_vec(),
        temporal: Some(Temporal {
            tau: windows.map(|window| window.1).to_vec(),
            s: windows.map(|window| window.2).to_vec(),
            ..Temporal::default()
        }),
        ..static_field(lives.len(), 0, 1)
    };
    let segments = split(&field, 16.0, 1.0);
    check_places(&field, 16.0, &segments);
    for segment in &segments {
        for &row in &segment.rows {
            let found = (segment.start_s, segment.duration_s, segment.level);
            assert_eq!(found, lives[row].1, "life {:?}", lives[row].0);
        }
    }
    // In the order of the file, and no segment is empty.
    let spans: Vec<_> = segments.iter().map(|segment| (segment.start_s, segment.duration_s)).collect();
    let expected = [
        (0.0, 16.0),
        (0.0, 8.0),
        (0.0, 4.0),
        (0.0, 2.0),
        (1.0, 2.0),
        (2.0, 4.0),
        (4.0, 8.0),
        (6.0, 4.0),
        (7.0, 2.0),
        (12.0, 4.0),
        (15.0, 1.0),
    ];
    assert_eq!(spans, expected);
}

/// A segment that is cut to the take holds its last instant, however its duration is rounded: 2.7 units have one that
/// begins after the first.
#[test]
fn cut_segments_end_with_the_take() {
    let mut field = static_field(1, 0, 1);
    // From 1.8 units to beyond the end.
    field.opacities = vec![(1f64.exp().powi(2) / 255.0) as f32];
    field.temporal = Some(Temporal { tau: vec![1.0], s: vec![0.15], ..Temporal::default() });
    let mut rounded = 0;
    for unit_s in (0..1_000).map(|i| 1.0 + 0.001 * f64::from(i)) {
        let duration_s = 2.7 * unit_s;
        let segments = split(&field, duration_s, unit_s);
        let [segment] = &segments[..] else { panic!("one segment") };
        assert_eq!((segment.start_s, segment.level), (unit_s, 0));
        assert!(segment.start_s + segment.duration_s >= duration_s, "{unit_s}");
        rounded += usize::from(segment.duration_s != duration_s - unit_s);
    }
    assert!(rounded > 0, "no duration was rounded");
}

#[test]
fn a_static_field_is_one_segment_as_it_was() {
    let field = static_field(9, 2, 1);
    let segments = split(&field, 60.0, 1.0);
    let expected = SplitSegment { start_s: 0.0, duration_s: 60.0, level: 5, rows: (0..9).collect(), field };
    assert_eq!(segments, [expected]);
    assert_eq!(split(&Field::default(), 60.0, 1.0), []);
}

#[test]
fn the_segment_that_spans_the_take_keeps_its_numbers() {
    // A unit longer than the take: all rows, unchanged, though the quotients are rounded.
    let field = many_lifetimes(400);
    for duration_s in [0.1, 1.32, 3.0, 119.7] {
        let segments = split(&field, duration_s, 1e4);
        assert_eq!(segments.len(), 1);
        assert_eq!((segments[0].start_s, segments[0].duration_s, segments[0].level), (0.0, duration_s, 0));
        assert!(segments[0].field == field, "{duration_s}");
    }
}

#[test]
fn grids_of_any_size_end() {
    let field = many_lifetimes(80);
    for (duration_s, unit_s) in [(1e9, 1e-9), (1e-9, 1e9), (120.0, 1e-9), (1e9, 1.0)] {
        check_places(&field, duration_s, &split(&field, duration_s, unit_s));
    }
}

#[test]
#[should_panic(expected = "1e-9 to 1e9 s")]
fn a_unit_of_zero_panics() {
    split(&static_field(1, 0, 1), 1.0, 0.0);
}

/// A field that was split makes a take whose segments have its Gaussians, by both coders.
#[test]
fn the_segments_of_a_field_make_a_take() {
    let field = many_lifetimes(600);
    let segments = split(&field, DURATION_S, UNIT_S);
    for coder in Coder::ALL {
        let encoded: Vec<Vec<u8>> = segments
            .iter()
            .map(|segment| {
                let info =
                    ClipInfo { duration_s: segment.duration_s as f32, viewpoints: Vec::new(), ..info() };
                let field = &segment.field;
                encode(&Source { info: &info, field, plate: None }, &options(coder, &[field.len() / 2 + 1]))
                    .unwrap()
            })
            .collect();
        let heads: Vec<_> =
            encoded.iter().map(|bytes| contents(bytes, &Limits::default()).unwrap()).collect();
        let entries: Vec<SegmentPackage> = segments
            .iter()
            .zip(&heads)
            .map(|(segment, contents)| SegmentPackage {
                start_s: segment.start_s,
                duration_s: segment.duration_s,
                level: segment.level,
                contents,
            })
            .collect();
        let mut bytes = encode_take_head(&info(), DURATION_S, &entries).unwrap();
        encoded.iter().for_each(|segment| bytes.extend_from_slice(segment));
        let take = package(&bytes, &Limits::default()).unwrap();
        assert_eq!(take.segments.iter().map(|segment| segment.gaussians()).sum::<usize>(), field.len());
        for (index, segment) in take.segments.iter().enumerate() {
            let bytes = &bytes[segment.offset as usize..][..segment.bytes()];
            let clip = take
                .decode_segment(index, bytes, &Limits::default(), std::num::NonZero::<usize>::MIN)
                .unwrap();
            assert_eq!(clip.len(), segments[index].rows.len());
        }
    }
}
