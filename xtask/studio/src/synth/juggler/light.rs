//! Baked shading: a warm key light, a cool light from behind, sky and floor.
//!
//! Light adds up in linear colour; the result is encoded for display.

use glam::{DVec3, dvec3};

/// Reflectance, linear red, green, blue.
pub(super) type Albedo = DVec3;

/// Visibility of the lights at a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Occlusion {
    /// Part of the key light that arrives, in `[0, 1]`.
    key: f64,
    /// Part of the ambient light that arrives, in `[0, 1]`.
    ambient: f64,
}

/// Unoccluded.
pub(super) const OPEN: Occlusion = Occlusion { key: 1.0, ambient: 1.0 };

/// Direction to the key light: in front, to the juggler's left, above.
const KEY: DVec3 = DVec3::new(0.483, 0.724, 0.493);
const KEY_COLOR: DVec3 = DVec3::new(1.0, 0.92, 0.78);
const KEY_STRENGTH: f64 = 1.05;

/// Direction to the light from behind.
const RIM: DVec3 = DVec3::new(-0.62, 0.42, -0.66);
const RIM_COLOR: DVec3 = DVec3::new(0.55, 0.72, 1.0);
const RIM_STRENGTH: f64 = 0.55;

const SKY: DVec3 = DVec3::new(0.36, 0.40, 0.50);
const FLOOR: DVec3 = DVec3::new(0.28, 0.21, 0.14);

/// The lights and their occluders.
pub(super) struct Light<'a> {
    distance: &'a dyn Fn(DVec3) -> f64,
}

impl<'a> Light<'a> {
    /// Lights for solids given by their signed distance.
    pub(super) fn new(distance: &'a dyn Fn(DVec3) -> f64) -> Light<'a> {
        Light { distance }
    }

    /// Occlusion of a point of a surface by the solids.
    pub(super) fn occlusion(&self, point: DVec3, normal: DVec3) -> Occlusion {
        // Five samples along the normal: the amount by which the distance falls short of the step.
        let mut ambient = 1.0;
        for (step, weight) in [(0.01, 4.0), (0.03, 3.0), (0.07, 1.9), (0.14, 1.0), (0.28, 0.45)] {
            ambient -= weight * (step - (self.distance)(point + normal * step)).max(0.0);
        }
        Occlusion { key: self.key(point + normal * 0.012), ambient: ambient.clamp(0.15, 1.0) }
    }

    /// Penumbra: the narrowest miss on the way to the light, relative to its distance.
    fn key(&self, point: DVec3) -> f64 {
        let mut lit = 1.0f64;
        let mut along = 0.0;
        while along < 2.5 {
            let d = (self.distance)(point + KEY * along);
            lit = lit.min(0.5 + 6.0 * d / (along + 0.06));
            if lit <= 0.0 {
                return 0.0;
            }
            along += d.clamp(0.006, 0.1);
        }
        lit * lit * (3.0 - 2.0 * lit)
    }

    /// The display-referred colour of a surface.
    pub(super) fn color(&self, albedo: Albedo, normal: DVec3, seen: Occlusion) -> DVec3 {
        let facing = |towards: DVec3| normal.dot(towards).max(0.0);
        // The key light wraps a little around the edge, as from a large lamp.
        let key = ((normal.dot(KEY) + 0.15) / 1.15).max(0.0) * seen.key * KEY_STRENGTH;
        let rim = facing(RIM) * RIM_STRENGTH * seen.ambient;
        let up = 0.5 + 0.5 * normal.y;
        let ambient = (SKY * up + FLOOR * (1.0 - up)) * seen.ambient;
        encode(albedo * (KEY_COLOR * key + RIM_COLOR * rim + ambient))
    }

    /// Shadow of a point on the floor, cast by the key light.
    pub(super) fn on_floor(&self, point: DVec3) -> DVec3 {
        let shadow = point - KEY * (point.y / KEY.y);
        dvec3(shadow.x, 0.004, shadow.z)
    }
}

/// 0 on one side of an edge and 1 on the other, with a seam about as wide as a Gaussian:
/// `inside` is the distance from the edge, positive on the side of 1.
pub(super) fn soft(inside: f64, spacing: f64) -> f64 {
    (0.5 + inside / spacing).clamp(0.0, 1.0)
}

/// A colour given as in a paint program: `0xrrggbb`.
pub(super) fn srgb(hex: u32) -> Albedo {
    let channel = |shift: u32| {
        let c = f64::from((hex >> shift) & 0xff) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    dvec3(channel(16), channel(8), channel(0))
}

/// Linear light to display values, highlights rolled off below 1.
fn encode(linear: DVec3) -> DVec3 {
    let channel = |c: f64| {
        let c = if c < 0.7 { c } else { 0.7 + 0.3 * (1.0 - (-(c - 0.7) / 0.3).exp()) };
        if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
    };
    dvec3(channel(linear.x), channel(linear.y), channel(linear.z))
}
