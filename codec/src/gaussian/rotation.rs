//! Quantises a rotation as the direction of the Gaussian's main axis and a roll about it.
//!
//! The main axis is the distinct one: the long axis of a needle, the short axis of a disc. Its sign
//! does not matter, so it lies on a hemisphere: around z, or around the main axis of a neighbour,
//! which may lie on the same surface. The roll has a period of half a turn.

use crate::rans::math::{self, Unit};

use std::f64::consts::PI;

/// Coarsest steps in radians; at these a rotation is practically unknown. Format.
const DIRECTION_STEP_MAX: f64 = 1.2;
const ROLL_STEP_MAX: f64 = 3.2;

/// Largest number of codes of a coordinate of the direction, or of the roll. Format.
const CODES_MAX: f64 = 16384.0;

/// Quantiser of the rotation of a Gaussian, from its blurred standard deviations.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotationQuantiser {
    /// Axes by width, the widest being 0: the axis that the roll turns from, the axis that it
    /// turns to, the main axis.
    pub(super) axes: [usize; 3],
    /// Number of codes of each coordinate of the direction.
    pub(super) direction_codes: u32,
    /// Number of codes of the roll.
    pub(super) roll_codes: u32,
    /// Steps of the direction and of the roll, in radians.
    pub(super) direction_step: f64,
    pub(super) roll_step: f64,
}

impl RotationQuantiser {
    /// The quantiser for these standard deviations, the widest first. `step` is the allowed error of
    /// the surface in standard deviations.
    pub(super) fn new(sigma: [f64; 3], step: f64) -> RotationQuantiser {
        let units = sigma.map(Unit::new);
        let is_needle = math::in_units(sigma[0], units[1]) > math::in_units(sigma[1], units[2]);
        let axes = if is_needle { [1, 2, 0] } else { [0, 1, 2] };
        // Relative change of the covariance per radian of rotation.
        let ratio = |a: usize, b: usize| {
            (math::in_units(sigma[a], units[b]) - math::in_units(sigma[b], units[a])).abs().max(1e-3)
        };
        let [a, b, main] = axes;
        let direction_step = (step / ratio(a, main).max(ratio(b, main))).min(DIRECTION_STEP_MAX);
        let roll_step = (step / ratio(a, b)).min(ROLL_STEP_MAX);
        RotationQuantiser {
            axes,
            direction_codes: rounded_up((2.0 / direction_step).clamp(1.0, CODES_MAX)),
            roll_codes: math::round(PI / roll_step).clamp(1.0, CODES_MAX) as u32,
            direction_step,
            roll_step,
        }
    }

    /// Whether the main axis is the longest one.
    pub(super) fn is_needle(&self) -> bool {
        self.axes[2] == 0
    }
}

/// The lowest integer that is not below `x`. The system's function is a call on some machines.
fn rounded_up(x: f64) -> u32 {
    let truncated = x as u32;
    truncated + u32::from(f64::from(truncated) < x)
}

/// Codes of a direction in the hemisphere around `pole`, by octahedral mapping to a square.
pub(super) fn direction_codes(direction: [f64; 3], pole: [f64; 3], codes: u32) -> [u32; 2] {
    let d = rotate(inverse(arc(pole)), direction);
    let d = if d[2] < 0.0 { d.map(|x| -x) } else { d };
    let norm = d[0].abs() + d[1].abs() + d[2];
    [d[0] + d[1], d[0] - d[1]].map(|x| {
        let position = (x / norm + 1.0) * 0.5 * f64::from(codes);
        (position as u32).min(codes - 1)
    })
}

/// The direction of two codes, with z at least 0.
pub(super) fn direction(direction_codes: [u32; 2], pole: [f64; 3], codes: u32) -> [f64; 3] {
    let codes = Unit::new(f64::from(codes));
    let [u, v] = direction_codes.map(|x| math::in_units(f64::from(x) + 0.5, codes) * 2.0 - 1.0);
    let (x, y) = ((u + v) * 0.5, (u - v) * 0.5);
    let d = rotate(arc(pole), normalized([x, y, 1.0 - x.abs() - y.abs()]));
    if d[2] < 0.0 { d.map(|x| -x) } else { d }
}

/// The axes of roll 0: world axes x and y, rotated by the shortest rotation of z to `direction`.
pub(super) fn roll_axes(direction: [f64; 3]) -> [[f64; 3]; 2] {
    let q = arc(direction);
    [rotate(q, [1.0, 0.0, 0.0]), rotate(q, [0.0, 1.0, 0.0])]
}

/// Unit quaternion w, x, y, z that rolls about z by `code`, then rotates z to `direction`.
pub(super) fn quaternion(direction: [f64; 3], code: u32, codes: u32) -> [f64; 4] {
    let half = (f64::from(code) + 0.5) / f64::from(codes) * (PI * 0.5);
    let (sin, cos) = math::sin_cos(half);
    let [w, x, y, _] = arc(direction);
    [w * cos, x * cos + y * sin, y * cos - x * sin, w * sin]
}

/// Unit quaternion of the shortest rotation of z to a direction with z >= 0.
fn arc([x, y, z]: [f64; 3]) -> [f64; 4] {
    let w = 1.0 + z;
    let norm = Unit::new((w * w + x * x + y * y).sqrt());
    [math::in_units(w, norm), math::in_units(-y, norm), math::in_units(x, norm), 0.0]
}

/// Inverse of a unit quaternion.
pub(super) fn inverse([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}

/// Rotates `v` by a unit quaternion.
pub(super) fn rotate([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + (y * t[2] - z * t[1]),
        v[1] + w * t[1] + (z * t[0] - x * t[2]),
        v[2] + w * t[2] + (x * t[1] - y * t[0]),
    ]
}

fn normalized(v: [f64; 3]) -> [f64; 3] {
    let norm = Unit::new((v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt());
    v.map(|x| math::in_units(x, norm))
}

/// Pole of the first Gaussian of a chunk.
pub(super) const FIRST_POLE: [f64; 3] = [0.0, 0.0, 1.0];
