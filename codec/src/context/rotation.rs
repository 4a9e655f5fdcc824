//! A rotation as the direction of the Gaussian's main axis and a roll about it.
//!
//! The main axis is the one that stands out: the long one of a needle, the short one of a disc.
//! Only its line matters, not its sense, so it lies on a hemisphere: that of z, or that around
//! the axis of a neighbour, whose surface it may share. The roll repeats after half a turn.

use super::math::{round, sin_cos};

use std::f64::consts::PI;

/// Coarsest steps in radians: beyond them a rotation is as good as unknown. Format.
const DIRECTION_STEP_MAX: f64 = 1.2;
const ROLL_STEP_MAX: f64 = 3.2;

/// Most codes of a coordinate of the direction, or of the roll. Format.
const CODES_MAX: f64 = 16384.0;

/// How finely a rotation is coded, and which axis is the main one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Numbers of the axes, the widest being 0: the one that the roll turns from, the one it
    /// turns to, the main one.
    pub(super) axes: [usize; 3],
    /// Codes of each coordinate of the direction.
    pub(super) direction_codes: u32,
    /// Codes of the roll.
    pub(super) roll_codes: u32,
    /// Steps of the direction and of the roll, in radians.
    pub(super) direction_step: f64,
    pub(super) roll_step: f64,
}

impl Shape {
    /// The shape of a Gaussian with these standard deviations, the widest first, whose surface
    /// may move by `step` in standard deviations.
    pub(super) fn new(sigma: [f64; 3], step: f64) -> Shape {
        let is_needle = sigma[0] / sigma[1] > sigma[1] / sigma[2];
        let axes = if is_needle { [1, 2, 0] } else { [0, 1, 2] };
        // Turning by an angle changes the covariance in proportion to this.
        let ratio = |a: usize, b: usize| (sigma[a] / sigma[b] - sigma[b] / sigma[a]).abs().max(1e-3);
        let [a, b, main] = axes;
        let direction_step = (step / ratio(a, main).max(ratio(b, main))).min(DIRECTION_STEP_MAX);
        let roll_step = (step / ratio(a, b)).min(ROLL_STEP_MAX);
        Shape {
            axes,
            direction_codes: (2.0 / direction_step).ceil().clamp(1.0, CODES_MAX) as u32,
            roll_codes: round(PI / roll_step).clamp(1.0, CODES_MAX) as u32,
            direction_step,
            roll_step,
        }
    }

    /// Whether the main axis is the longest one.
    pub(super) fn is_needle(&self) -> bool {
        self.axes[2] == 0
    }
}

/// Codes of a direction in the hemisphere around `pole`: an octahedron unfolded to a square.
pub(super) fn direction_codes(direction: [f64; 3], pole: [f64; 3], codes: u32) -> [u32; 2] {
    let d = turn(inverse(arc(pole)), direction);
    let d = if d[2] < 0.0 { d.map(|x| -x) } else { d };
    let norm = d[0].abs() + d[1].abs() + d[2];
    [d[0] + d[1], d[0] - d[1]].map(|x| {
        let place = (x / norm + 1.0) * 0.5 * f64::from(codes);
        (place as u32).min(codes - 1)
    })
}

/// The direction of two codes, with z at least 0.
pub(super) fn direction(place: [u32; 2], pole: [f64; 3], codes: u32) -> [f64; 3] {
    let [u, v] = place.map(|x| (f64::from(x) + 0.5) / f64::from(codes) * 2.0 - 1.0);
    let (x, y) = ((u + v) * 0.5, (u - v) * 0.5);
    let d = turn(arc(pole), normalized([x, y, 1.0 - x.abs() - y.abs()]));
    if d[2] < 0.0 { d.map(|x| -x) } else { d }
}

/// The axes x and y that a roll starts from: those of the world, turned the shortest way so that
/// z becomes `direction`.
pub(super) fn roll_axes(direction: [f64; 3]) -> [[f64; 3]; 2] {
    let q = arc(direction);
    [turn(q, [1.0, 0.0, 0.0]), turn(q, [0.0, 1.0, 0.0])]
}

/// Unit quaternion w, x, y, z that turns the axes x, y, z into those of a Gaussian: z into
/// `direction`, after a roll of `code`.
pub(super) fn quaternion(direction: [f64; 3], code: u32, codes: u32) -> [f64; 4] {
    let half = (f64::from(code) + 0.5) / f64::from(codes) * (PI * 0.5);
    let (sin, cos) = sin_cos(half);
    let [w, x, y, _] = arc(direction);
    [w * cos, x * cos + y * sin, y * cos - x * sin, w * sin]
}

/// Unit quaternion that turns z into `direction` the shortest way; `direction` has z >= 0.
fn arc([x, y, z]: [f64; 3]) -> [f64; 4] {
    let w = 1.0 + z;
    let norm = (w * w + x * x + y * y).sqrt();
    [w / norm, -y / norm, x / norm, 0.0]
}

fn inverse([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}

/// `v` turned by a unit quaternion.
pub(super) fn turn([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + (y * t[2] - z * t[1]),
        v[1] + w * t[1] + (z * t[0] - x * t[2]),
        v[2] + w * t[2] + (x * t[1] - y * t[0]),
    ]
}

fn normalized(v: [f64; 3]) -> [f64; 3] {
    let norm = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|x| x / norm)
}

/// The direction that a chunk starts from.
pub(super) const FIRST_POLE: [f64; 3] = [0.0, 0.0, 1.0];
