//! Signed distance functions: negative inside, in metres, exact or slightly too small outside.

use glam::{DQuat, DVec3, dvec3};

/// A solid.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    /// Two balls and the cone between them: a limb.
    Cone { from: DVec3, to: DVec3, radii: [f64; 2] },
    /// An ellipsoid with its axes turned.
    Ellipsoid { center: DVec3, radii: DVec3, rotation: DQuat },
}

impl Shape {
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        match *self {
            Shape::Cone { from, to, radii } => {
                let (h, nearest) = on_segment(p, from, to);
                (p - nearest).length() - (radii[0] + (radii[1] - radii[0]) * h)
            }
            Shape::Ellipsoid { center, radii, rotation } => {
                let q = rotation.inverse() * (p - center);
                let (k0, k1) = ((q / radii).length(), (q / (radii * radii)).length());
                if k1 < 1e-9 { -radii.min_element() } else { k0 * (k0 - 1.0) / k1 }
            }
        }
    }
}

/// The point of a segment nearest to `p`, and its place in `[0, 1]`.
pub(super) fn on_segment(p: DVec3, from: DVec3, to: DVec3) -> (f64, DVec3) {
    let axis = to - from;
    let h = ((p - from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    (h, from + axis * h)
}

/// Union whose seam is rounded over about `k` metres.
pub(super) fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * h * h * k
}

/// Unit normal: direction of the steepest rise.
pub(super) fn normal(distance: &dyn Fn(DVec3) -> f64, p: DVec3) -> DVec3 {
    let h = 2e-4;
    let slope = |axis: DVec3| distance(p + h * axis) - distance(p - h * axis);
    dvec3(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).normalize_or(DVec3::Y)
}
