//! Takes: segments hours from the start, lives far shorter and far longer than a segment, lives that end at a cut,
//! cuts whose seconds are rounded, thousands of segments. The reference draws the field unsplit.

use client::gpu::Span;
use codec::{ALPHA_MIN, Clip, Field, split};

use super::case::{StabilityCase, StabilityScene, TakeScene, at, case, exact};
use super::gaussians::{Gaussian, crowd, field, static_crowd};

const GROUP: &str = "takes";

/// Why the segments are not encoded.
const UNTRIED: &str = "each segment is a clip, and other cases encode those";

// Long: a table of cases.
pub(super) fn cases() -> Vec<StabilityCase> {
    let own_time = "the instant less the start in f64, then clip time of the segment in two f32";
    vec![
        case(GROUP, "lives of a second after 100 hours", 2.0, own_time, || {
            let (take_s, from_s) = (400_000.0, 360_000.0);
            // A window centre of f32 is exact to 10 ms here, in the field unsplit and so in its segments.
            let rows = lives(200, take_s, |part| (from_s + 6.0 * part, 0.6));
            split_take(&field(&rows), take_s, 1.0, &seconds(from_s, from_s + 6.0, 13))
        }),
        case(GROUP, "a segment that starts after 100 hours, at instants 1 ms apart", 2.0, own_time, || {
            // Fast enough to be elsewhere after a millisecond: in f32, seconds after 100 hours are 31 ms apart.
            let (take_s, start_s, length_s) = (400_000.0, 360_000.0, 2.0);
            let span = Span { start_s, duration_s: length_s };
            let rows = lives(200, length_s, |part| (length_s * part, 0.05));
            let fast = |row: Gaussian| Gaussian { motion: [[40.0, 20.0, 0.0], [0.0; 3], [0.0; 3]], ..row };
            let own = field(&rows.into_iter().map(fast).collect::<Vec<_>>());
            let instants: Vec<f64> = (0..12).map(|i| start_s + 0.7 + 1e-3 * f64::from(i)).collect();
            let whole = exact(own.clone());
            let meant = instants.iter().map(|t_s| (t_s - start_s) / length_s).collect();
            take(whole, vec![(span, own)], take_s, &instants, Some(meant))
        }),
        case(
            GROUP,
            "lives of a ten-thousandth of their segment",
            2.0,
            "time in two f32; a window belongs to the segment in which it begins",
            || {
                let rows = lives(300, 60.0, |part| (20.0 + 0.02 * part, 0.002));
                split_take(&field(&rows), 60.0, 10.0, &seconds(20.0, 20.02, 21))
            },
        ),
        case(
            GROUP,
            "lives a million times as long as a segment, among short ones",
            2.0,
            "what outlives the take is in the segment that spans it",
            || {
                let short = lives(100, 8.0, |part| (8.0 * part, 0.2));
                let long = lives(100, 8.0, |part| (8.0 * part, 1e6));
                let rows = [short, static_crowd(50), long].concat();
                split_take(&field(&rows), 8.0, 0.5, &seconds(0.0, 8.0, 17))
            },
        ),
        case(
            GROUP,
            "what is always on for an hour, among lives of frames",
            2.0,
            "a window of 16 takes, as a fit gives what stands still, opens and closes by 0.2 % at most; lives of frames are \
             in segments of their own",
            || {
                let take_s = 3600.0;
                // Windows that are centred at the beginning, in the middle and at the end of the take.
                let always = static_crowd(60).into_iter().enumerate();
                let always = always.map(|(i, row)| Gaussian { tau: 0.5 * (i % 3) as f32, s: 16.0, ..row });
                let short = lives(200, take_s, |part| (1800.0 + 4.0 * part, 0.12));
                let rows: Vec<Gaussian> = always.chain(short).collect();
                let instants = [seconds(1800.0, 1804.0, 13), vec![0.0, 3599.0, take_s]].concat();
                split_take(&field(&rows), take_s, 1.0, &instants)
            },
        ),
        case(
            GROUP,
            "lives that end and begin at a cut",
            2.0,
            "a segment holds its start and not its end; a life that touches the end is on the next level",
            || {
                // Half of them end at 2 s, the others begin there.
                let life_s = 0.5;
                let rows = lives(200, 6.0, |part| {
                    let side = if ((200.0 * part) as usize).is_multiple_of(2) { -0.5 } else { 0.5 };
                    (2.0 + side * life_s, life_s)
                });
                let near = [-0.25, -0.01, -1e-6, 0.0, 1e-6, 0.01, 0.25].map(|offset| 2.0 + offset);
                split_take(
                    &field(&rows),
                    6.0,
                    1.0,
                    &[&near[..], &[2f64.next_down(), 2f64.next_up()]].concat(),
                )
            },
        ),
        case(
            GROUP,
            "cuts at seconds that have no exact sum",
            1.5,
            "starts and ends are compared with a tolerance of 1e-9 s, so one segment holds every instant",
            || {
                // Every segment shows the same, so two of them, or none, would differ from one.
                let (count, take_s) = (30, 10.0);
                let static_field = field(&static_crowd(120));
                let length_s = take_s / f64::from(count);
                let segments = (0..count).map(|i| {
                    (Span { start_s: f64::from(i) * length_s, duration_s: length_s }, static_field.clone())
                });
                let cuts = (0..=count).map(|i| f64::from(i) * length_s);
                let instants: Vec<f64> =
                    cuts.flat_map(|cut| [cut.next_down().max(0.0), cut, cut.next_up().min(take_s)]).collect();
                take(exact(static_field.clone()), segments.collect(), take_s, &instants, None)
            },
        ),
        case(
            GROUP,
            "thousands of segments",
            2.0,
            "the segments of an instant are resident, and no more",
            || {
                let rows = lives(4000, 600.0, |part| (600.0 * part, 0.1));
                let field = field(&rows);
                let segments = split(&field, 600.0, 0.1).len();
                assert!(segments > 2000, "only {segments} segments");
                split_take(&field, 600.0, 0.1, &seconds(0.0, 600.0, 25))
            },
        ),
    ]
}

/// Gaussians in a take of `take_s` seconds; `life` maps their fraction of the rows to the second in the middle of
/// their life, and the length of that.
fn lives(count: usize, take_s: f64, life: impl Fn(f64) -> (f64, f64)) -> Vec<Gaussian> {
    let mut rows = crowd(count);
    for (i, row) in rows.iter_mut().enumerate() {
        let (middle_s, length_s) = life((i as f64 + 0.5) / count as f64);
        // Widths of a window from its centre to where the opacity falls to 1/255.
        let radius = (2.0 * (f64::from(row.opacity) / ALPHA_MIN).ln()).sqrt();
        let (tau, s) = (middle_s / take_s, 0.5 * length_s / take_s / radius);
        *row = Gaussian { tau: tau as f32, s: s as f32, motion: [[0.0; 3]; 3], ..*row };
    }
    rows
}

/// Evenly spread seconds, both ends included.
fn seconds(from_s: f64, to_s: f64, count: u32) -> Vec<f64> {
    (0..count).map(|i| from_s + (to_s - from_s) * f64::from(i) / f64::from(count - 1)).collect()
}

/// A field of `take_s` seconds as a take that [`split`] makes of it, at these seconds.
fn split_take(field: &Field, take_s: f64, unit_s: f64, instants: &[f64]) -> StabilityScene {
    let segments = split(field, take_s, unit_s).into_iter();
    let segments = segments
        .map(|segment| (Span { start_s: segment.start_s, duration_s: segment.duration_s }, segment.field));
    take(exact(field.clone()), segments.collect(), take_s, instants, None)
}

/// A take of these segments, at these seconds. The reference draws `whole`, at clip times `meant` if they differ from
/// the take's clip times.
fn take(
    whole: Clip,
    segments: Vec<(Span, Field)>,
    take_s: f64,
    instants: &[f64],
    meant: Option<Vec<f64>>,
) -> StabilityScene {
    let times: Vec<f64> = instants.iter().map(|t_s| t_s / take_s).collect();
    let segments = segments.into_iter().map(|(span, field)| (span, exact(field))).collect();
    let take = TakeScene { duration_s: take_s, segments, meant: meant.unwrap_or_else(|| times.clone()) };
    StabilityScene { take: Some(take), clip: whole, ..StabilityScene::new(Field::default(), at(&times)) }
        .untried(UNTRIED)
}
