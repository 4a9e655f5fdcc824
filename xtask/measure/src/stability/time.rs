//! Stiff in time: windows from a millionth to a million clips wide, window centres outside the clip, motion that
//! overflows or cancels.

use super::case::{StabilityCase, StabilityScene, at, case};
use super::gaussians::{Gaussian, crowd, field};

const GROUP: &str = "stiff in time";

/// Widths of windows: the powers of ten from 1e-6 to 1e6 clips.
fn widths() -> impl Iterator<Item = f32> {
    (-6..=6).map(|k| 10f32.powi(k))
}

/// The centre of the `i`-th Gaussian of a grid with five columns.
fn place(i: usize) -> [f32; 3] {
    [0.55 * (i % 5) as f32 - 1.1, 0.55 * (i / 5) as f32 - 0.8, 0.0]
}

// Long: a table of cases.
pub(super) fn cases() -> Vec<StabilityCase> {
    vec![
        case(
            GROUP,
            "windows from 1e-6 to 1e6 of the clip",
            2.0,
            "time in two f32; records about an instant in the window, 1/s in f16 with a unit of its own",
            || {
                let row = |(i, s)| Gaussian {
                    center: place(i),
                    tau: 0.5 + 0.013 * i as f32,
                    s,
                    ..Gaussian::default()
                };
                let rows: Vec<Gaussian> =
                    widths().enumerate().map(|(i, s)| row((i, s)).sized([0.12; 3])).collect();
                let around = |row: &Gaussian| {
                    let (tau, s) = (f64::from(row.tau), f64::from(row.s));
                    [-2.5, -1.0, 0.0, 0.7, 2.0].map(|z| (tau + z * s).clamp(0.0, 1.0))
                };
                let instants: Vec<f64> = rows.iter().flat_map(around).collect();
                StabilityScene::new(field(&rows), at(&instants))
            },
        ),
        case(
            GROUP,
            "windows of no width",
            2.0,
            "narrower than 5e-7 of the clip, so visible at its instant and invisible beside it, without fading",
            || {
                let rows =
                    [1e-9, 1e-20, f32::MIN_POSITIVE, 1e-45].map(|s| Gaussian { s, ..Gaussian::default() });
                // At the instant of a record, and between the instants of two.
                let tau = [0.5f32, 0.3];
                let rows = tau.into_iter().flat_map(|tau| rows.map(|row| Gaussian { tau, ..row }));
                let rows: Vec<Gaussian> =
                    (0..).zip(rows).map(|(i, row)| Gaussian { center: place(i), ..row }).collect();
                let between = f64::from(tau[1]);
                let instants = [0.5, 0.5 + 1e-6, 0.5 - 1e-6, 0.2, between, between + 1e-6, between - 1e-6];
                StabilityScene::new(field(&[rows, crowd(20)].concat()), at(&instants))
                    .untried("coders move a window by more than this width")
            },
        ),
        case(GROUP, "windows between two frames, at the frames", 1.5, "not alive, so not drawn", || {
            StabilityScene {
                blank: true,
                ..StabilityScene::new(between_frames(), at(&FRAMES.map(|k| k / 30.0)))
            }
        }),
        case(
            GROUP,
            "windows between two frames, between them",
            1.5,
            "the time index finds windows at any instant, not only at frames",
            || StabilityScene::new(between_frames(), at(&FRAMES.map(|k| (k + 0.5) / 30.0))),
        ),
        case(
            GROUP,
            "window centres outside the clip",
            1.5,
            "records about the part of the window that lies in the clip",
            || {
                let row = |(i, (tau, s)): (usize, (f32, f32))| {
                    let center = place(i);
                    // Moves through its place at the nearer end of the clip.
                    let at = tau.clamp(0.0, 1.0) - tau;
                    let v = [0.9, -0.4, 0.6];
                    let start: [f32; 3] = std::array::from_fn(|axis| center[axis] - v[axis] * at);
                    let motion = [v, [0.0; 3], [0.0; 3]];
                    Gaussian { center: start, tau, s, motion, ..Gaussian::default() }.sized([0.2; 3])
                };
                let windows =
                    [(-3.0, 1.2), (-0.4, 0.2), (1.3, 0.15), (5.0, 2.0), (-40.0, 15.0), (900.0, 400.0)];
                let rows: Vec<Gaussian> = windows.into_iter().enumerate().map(row).collect();
                StabilityScene::new(field(&[rows, crowd(20)].concat()), at(&[0.0, 0.1, 0.5, 0.9, 1.0]))
            },
        ),
        case(
            GROUP,
            "at, before and after the ends of the clip",
            1.5,
            "instants are clamped to the clip; NaN counts as its start",
            || {
                let instants = [0.0, -1e-9, -1.0, -1e300, 1.0, 1.0 + 1e-9, 2.0];
                let others = [f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
                StabilityScene::new(field(&crowd(80)), at(&[&instants[..], &others].concat()))
            },
        ),
        case(
            GROUP,
            "a jerk of 1e9 in a window of 1e-3",
            2.0,
            "motion is stored per width of the window",
            || jerk(1e9, 1e-3),
        ),
        case(
            GROUP,
            "a jerk of 1e15 in a window of 1e-5",
            2.0,
            "motion is stored per width of the window",
            || jerk(1e15, 1e-5).refused("column motion"),
        ),
        case(
            GROUP,
            "a cubic that overflows f32 outside its window",
            2.0,
            "only rows that are alive reach the GPU; positions that are not finite on the CPU are culled",
            || {
                let motion = [[f32::MAX, -f32::MAX, f32::MAX]; 3];
                let row = Gaussian { tau: 0.25, s: 1e-12, motion, ..Gaussian::default() };
                let instants = at(&[0.25, 0.0, 0.3, 1.0]);
                StabilityScene::new(field(&[vec![row], crowd(20)].concat()), instants)
                    .refused("column motion")
            },
        ),
        case(
            GROUP,
            "a centre that cancels against its motion",
            2.0,
            "expanded in f64 about an instant within the clip, so that nothing cancels on the GPU",
            || {
                // (t - 0.5) + 2 (t - 0.5)^2 - 3 (t - 0.5)^3 in each axis, about tau.
                let row = |(i, tau): (usize, f64)| {
                    let a = tau - 0.5;
                    let place = place(i + 5);
                    let start = a + 2.0 * a * a - 3.0 * a * a * a;
                    let v = [1.0 + 4.0 * a - 9.0 * a * a, 2.0 - 9.0 * a, -3.0];
                    Gaussian {
                        center: place.map(|x| (f64::from(x) + start) as f32),
                        tau: tau as f32,
                        s: (0.5 * a.abs()) as f32,
                        motion: v.map(|v| [v as f32; 3]),
                        ..Gaussian::default()
                    }
                    .sized([0.2; 3])
                };
                let rows: Vec<Gaussian> = [-9.5, -31.5, -99.5].into_iter().enumerate().map(row).collect();
                StabilityScene::new(field(&[rows, crowd(20)].concat()), at(&[0.0, 0.3, 0.5, 0.7, 1.0]))
                    .untried("rounding the centre moves it out of view")
            },
        ),
        case(
            GROUP,
            "5000 windows of 1e-4 at once",
            4.0,
            "a candidate costs one test, an alive row one record",
            || short_windows(|_| 0.5),
        ),
        case(
            GROUP,
            "5000 windows of 1e-4 all over the clip",
            2.0,
            "the time index lists only windows that start near the instant",
            || short_windows(|part| part),
        ),
        case(
            GROUP,
            "turning at 1e9, and through the zero quaternion",
            2.0,
            "rotated in f64 to the record's instant; rates are limited to 2^20 per width",
            || {
                let turning = |i: usize, s: f32, rotation: [f32; 4], rate: [f32; 4]| {
                    Gaussian { center: place(i), s, rotation, rate, ..Gaussian::default() }
                        .sized([0.25, 0.05, 0.1])
                };
                let unit = [1.0, 0.0, 0.0, 0.0];
                let rows = vec![
                    turning(1, 0.1, unit, [0.0, 0.0, 0.0, 1e9]),
                    turning(3, 1e-4, unit, [0.0, 2e3, 0.0, 1e4]),
                    // Zero at 0.75.
                    turning(6, 1.0, unit, [-4.0, 0.0, 0.0, 0.0]),
                    turning(8, 1.0, [0.6, 0.0, 0.0, 0.8], [-2.4, 0.0, 0.0, -3.2]),
                ];
                let rows = [rows, crowd(20)].concat();
                StabilityScene::new(field(&rows), at(&[0.5, 0.50005, 0.6, 0.25, 0.9]))
                    .untried("a rate of 1e9 leaves no precision for the other rates")
            },
        ),
    ]
}

/// Frames at which the windows are tested.
const FRAMES: [f64; 4] = [0.0, 7.0, 14.0, 29.0];

/// Windows that are open only between two frames of a clip of 30 frames.
fn between_frames() -> codec::Field {
    let row = |k: usize| {
        Gaussian { center: place(k % 20), tau: (k as f32 + 0.5) / 30.0, s: 0.002, ..Gaussian::default() }
            .sized([0.2; 3])
    };
    field(&(0..30).map(row).collect::<Vec<_>>())
}

/// A cubic that moves a Gaussian by a few of its sizes within its window, and far away outside it.
fn jerk(v3: f32, s: f32) -> StabilityScene {
    let motion = [[0.0; 3], [0.0; 3], [v3, -0.5 * v3, 0.0]];
    let row = Gaussian { s, motion, ..Gaussian::default() };
    let widths = [-2.0, -1.0, -0.5, 0.0, 0.4, 0.8];
    let mut instants: Vec<f64> = widths.map(|z| 0.5 + z * f64::from(s) * 0.4).to_vec();
    instants.extend([0.0, 0.2, 1.0]);
    StabilityScene::new(field(&[vec![row], crowd(20)].concat()), at(&instants))
}

/// 5000 small Gaussians with very short windows; `tau` maps their fraction of the rows to the window centre.
fn short_windows(tau: impl Fn(f32) -> f32) -> StabilityScene {
    const COUNT: usize = 5000;
    let mut rows = crowd(COUNT);
    for (i, row) in rows.iter_mut().enumerate() {
        *row = Gaussian {
            tau: tau((i as f32 + 0.5) / COUNT as f32),
            s: 1e-4,
            motion: [[0.0; 3]; 3],
            opacity: 0.4,
            ..*row
        }
        .sized([0.04; 3]);
    }
    StabilityScene::new(field(&rows), at(&[0.5, 0.50012, 0.4999, 0.2501]))
}
