//! [`Moment`]: a dynamic Gaussian, expanded about an instant at which it is visible.
//!
//! A field expands motion about the centre of the window, which may be far outside the clip, and in powers
//! of clip time, which makes coefficients of narrow windows huge. A moment is expanded in f64 about the
//! centre of the window's overlap with the clip, and time is measured in widths of the window (in clips for
//! wider windows). Its coefficients are therefore as large as the visible motion.
//!
//! # Errors of a record
//!
//! At an instant `t` at which the Gaussian is alive, with `h = 2^-11`, the rounding of f16:
//!
//! - Position: `h (|w1 u| + |w2 u^2| + |w3 u^3|)`, a two-thousandth of each term, or
//!   `2^-35 |u|`, `2^-32 |u|^2` and `2^-29 |u|^3` of the bounds of the clip if that is more. A visible
//!   Gaussian has `|u| <= 3.4`, plus the rounding of `t0` to 65536ths: up to 8 at a width of 1e-6, twice
//!   that at the end of the clip.
//! - Opacity: `z` is off by `h |t - t0| / s` for the rounding of `1/s` and by `2^-11` for the rounding of `z0`; `|t -
//!   t0| / s <= |z| + |z0|`; the slope of `exp(-z^2 / 2)` is `|z| exp(-z^2 / 2) <= 0.61`, and `z^2 exp(-z^2 / 2) <=
//!   0.74`. Together `h (1.35 + 0.61 |z0|)` of a full alpha: 0.17 of an 8-bit step if the centre of the window is in
//!   the clip, and 0.43 if the clip contains only its end, 3.4 widths away. With the rounding of `t0`, it is 0.8 of a
//!   step at a width of 1e-6.
//! - Rotation: `h` of the quaternion's change since `t0`, or `2^-20 |u|` if that is more.

use codec::{Field, Temporal};
use half::f16;
use shaders::WIDTH_UNIT;

/// Resolution of instants, in steps per clip.
pub(in crate::gpu) const INSTANTS: f64 = 65536.0;

/// Resolution of `z0`, in steps per width.
pub(in crate::gpu) const Z_STEPS: f64 = 1024.0;

/// Limit of motion coefficients, in units of the field per width. A faster Gaussian is visible for a
/// millionth of its window, and must not cost the others their precision.
pub(super) const MOTION_MAX: f64 = 16_777_216.0;

/// Limit of angular rates per width, which f16 holds in units of [`RATE_UNIT`](shaders::RATE_UNIT): such a rotation is
/// the rotation of the rate, of either sign, but for a millionth of the window.
const RATE_MAX: f64 = 1_048_576.0;

/// A row of a field about the instant `t0`. With `d = t - t0` and `u = d max(1, 1/s)` its position is
/// `position + w1 u + w2 u^2 + w3 u^3`, its rotation `rotation + rates u`, normalised, and its opacity
/// `o exp(-(z0 + d/s)^2 / 2)`. Where the row is never alive, an opacity of 0 and nothing else.
#[derive(Default)]
pub(in crate::gpu) struct Moment {
    /// `t0` in 65536ths of the clip.
    pub(in crate::gpu) instant: u16,
    /// `z0 = (t0 - tau) / s` in 1024ths.
    pub(in crate::gpu) z: i16,
    /// `1/s` in units of [`WIDTH_UNIT`].
    pub(in crate::gpu) widths: f16,
    /// In the world of the field.
    pub(in crate::gpu) position: [f64; 3],
    /// `w1`, `w2`, `w3`; zero where the field has no such power.
    pub(in crate::gpu) motion: [[f32; 3]; 3],
    /// Quaternion `w, x, y, z` of any length.
    pub(in crate::gpu) rotation: [f64; 4],
    /// In lengths of `rotation`.
    pub(in crate::gpu) rates: [f32; 4],
}

impl Moment {
    /// `t0`, in clip time.
    pub(in crate::gpu) fn instant(&self) -> f32 {
        f32::from(self.instant) / INSTANTS as f32
    }

    /// `1/s`, per clip.
    fn widths(&self) -> f32 {
        self.widths.to_f32() * WIDTH_UNIT
    }

    /// `max(1, 1/s)`: `u` is `d` times this.
    pub(in crate::gpu) fn units(&self) -> f32 {
        self.widths().max(1.0)
    }

    /// Row `row` of `field`, whose temporal columns are `temporal`.
    pub(in crate::gpu) fn new(field: &Field, temporal: &Temporal, row: usize) -> Moment {
        let Some((start, end)) = field.alive_interval(row) else {
            return Moment { z: i16::MAX, ..Moment::default() };
        };
        let (tau, s) = (f64::from(temporal.tau[row]), f64::from(temporal.s[row]));
        // The casts cut to the range.
        let instant = (0.5 * (start + end) * INSTANTS).round() as u16;
        let t0 = f64::from(instant) / INSTANTS;
        // Of a window that is narrower than a record can say, all but its centre is wrong.
        let rate = (1.0 / s).min(f16::MAX.to_f64() * f64::from(WIDTH_UNIT));
        let widths = f16::from_f64(rate / f64::from(WIDTH_UNIT));
        let unit = 1.0 / (widths.to_f64() * f64::from(WIDTH_UNIT)).max(1.0);
        let (rotation, rates) = rotation(field, temporal, row, t0 - tau, unit);
        Moment {
            instant,
            z: ((t0 - tau) * rate * Z_STEPS).round() as i16,
            widths,
            position: field.position_at(row, t0),
            motion: motion(temporal.motion_of(row), t0 - tau, unit),
            rotation,
            rates,
        }
    }
}

/// Coefficients of `v1 d + v2 d^2 + v3 d^3` expanded about `d = at`, without the constant, in powers
/// of `d / unit`.
fn motion(v: &[[f32; 3]], at: f64, unit: f64) -> [[f32; 3]; 3] {
    let mut motion = [[0.0; 3]; 3];
    for axis in 0..3 {
        let v = |power: usize| v.get(power - 1).map_or(0.0, |v| f64::from(v[axis]));
        let expanded = [v(1) + (2.0 * v(2) + 3.0 * v(3) * at) * at, v(2) + 3.0 * v(3) * at, v(3)];
        for (power, c) in (1..).zip(expanded) {
            motion[power as usize - 1][axis] = (c * unit.powi(power)).clamp(-MOTION_MAX, MOTION_MAX) as f32;
        }
    }
    motion
}

/// The quaternion `at` after the centre of the window, and its rate per `unit` of time.
fn rotation(field: &Field, temporal: &Temporal, row: usize, at: f64, unit: f64) -> ([f64; 4], [f32; 4]) {
    let q = field.rotations[row].map(f64::from);
    let Some(rates) = &temporal.rotation_rates else {
        return (q, [0.0; 4]);
    };
    let rate = rates[row].map(f64::from);
    let turned: [f64; 4] = std::array::from_fn(|k| q[k] + rate[k] * at);
    let norm = length(turned);
    if norm < 1e-12 {
        // It passes through zero here. Before and after it is the rate, of either sign, which is the
        // same rotation.
        return (rate, [0.0; 4]);
    }
    let rate = rate.map(|x| x * unit / norm);
    let shorten = (RATE_MAX / length(rate)).min(1.0);
    (turned, rate.map(|x| (x * shorten) as f32))
}

/// Length of a quaternion.
pub(in crate::gpu) fn length(q: [f64; 4]) -> f64 {
    q.iter().map(|x| x * x).sum::<f64>().sqrt()
}
