//! A figure with thin limbs that a ranking severs and the topology floor preserves.
//!
//! A body of large Gaussians, many more than it needs, carries limbs of small ones. Visibility mass ranks
//! the whole body before any limb. Half of the limbs end in a small dense bead, which a tight budget
//! deletes; the others end in a heavy fist, which it keeps but severs.

use std::f64::consts::TAU;

use codec::{ClipInfo, Field, SH_C0, Viewpoint};
use glam::{DVec3, dvec3};

/// Gaussians of the body, and its size in source units.
const BODY: usize = 8_200;
const BODY_RADIUS: f64 = 0.5;
const BODY_SIGMA: f64 = 0.04;

/// Any two numbers without a common factor: every part of the body is spread over all of it.
const BODY_STRIDE: usize = 3_571;

/// Number of limbs, their Gaussians per unit of length, and their size.
const LIMBS: usize = 6;
const LIMB_DENSITY: f64 = 240.0;
const LIMB_RADIUS: f64 = 0.01;
const LIMB_SIGMA: f64 = 0.008;

/// The end of a limb.
struct Tip {
    /// Distance from the centre of the body.
    distance: f64,
    radius: f64,
    sigma: f64,
}

/// Gaussians as small as the limb's.
const BEAD: Tip = Tip { distance: 1.6, radius: 0.015, sigma: LIMB_SIGMA };

/// Gaussians larger than the body's.
const FIST: Tip = Tip { distance: 0.95, radius: 0.06, sigma: 0.052 };

/// Number of Gaussians of a tip.
const TIP: usize = 60;

/// The static figure.
pub fn figure() -> (Field, ClipInfo) {
    let mut figure = Field::default();
    for i in 0..BODY {
        let direction = direction(i * BODY_STRIDE % BODY, BODY);
        push(&mut figure, BODY_RADIUS * direction, BODY_SIGMA, 0.8, [0.6, 0.2, 0.1]);
    }
    for limb in 0..LIMBS {
        let tip = if limb % 2 == 0 { BEAD } else { FIST };
        let outwards = limb_direction(limb);
        let (across, up) = outwards.any_orthonormal_pair();
        // A limb adds no peak where it meets the body or the tip.
        let (start, end) = (BODY_RADIUS + 2.0 * BODY_SIGMA, tip.distance - tip.radius - 2.0 * tip.sigma);
        let count = ((end - start) * LIMB_DENSITY).round() as usize;
        for i in 0..count {
            let along = start + (i as f64 + 0.5) / count as f64 * (end - start);
            let (sin, cos) = (golden(i) * TAU).sin_cos();
            let center = outwards * along + LIMB_RADIUS * (cos * across + sin * up);
            push(&mut figure, center, LIMB_SIGMA, 0.8, [0.9, 0.7, 0.5]);
        }
        for i in 0..TIP {
            let center = tip.distance * outwards + tip.radius * direction(i, TIP);
            push(&mut figure, center, tip.sigma, 0.9, [0.2, 0.5, 0.9]);
        }
    }
    let viewpoint =
        Viewpoint { name: "front".into(), position: [0.0, 0.5, 5.0], target: [0.0; 3], fov_y: 0.8 };
    let viewpoints = vec![viewpoint];
    let info = ClipInfo { up: [0.0, 1.0, 0.0], metres_per_unit: 0.5, viewpoints, ..ClipInfo::default() };
    (figure, info)
}

/// Limbs are spread around the vertical, neighbours on either side of the horizontal.
fn limb_direction(limb: usize) -> DVec3 {
    let (sin, cos) = (TAU * limb as f64 / LIMBS as f64).sin_cos();
    dvec3(cos, if limb.is_multiple_of(3) { 0.5 } else { -0.3 }, sin).normalize()
}

/// One of `count` evenly spread directions.
fn direction(i: usize, count: usize) -> DVec3 {
    let y = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
    let (sin, cos) = (TAU * golden(i)).sin_cos();
    let r = (1.0 - y * y).sqrt();
    dvec3(r * cos, y, r * sin)
}

/// Multiples of the golden ratio, which never come near to repeating.
fn golden(i: usize) -> f64 {
    (i as f64 * 0.618_033_988_749_894_9).fract()
}

fn push(field: &mut Field, center: DVec3, sigma: f64, opacity: f32, color: [f64; 3]) {
    field.centers.push(center.as_vec3().to_array());
    field.rotations.push([1.0, 0.0, 0.0, 0.0]);
    field.log_scales.push([sigma.ln() as f32; 3]);
    field.opacities.push(opacity);
    field.sh.push(color.map(|c| ((c - 0.5) / SH_C0) as f32));
}

#[cfg(test)]
mod tests {
    use super::*;
    use refine::prune::{Floor, FloorSettings, Measure, Ranking, Retained, by_importance};

    /// What visibility mass with the floor keeps of the figure.
    fn floored(measure: Measure) -> Retained {
        let (field, _) = figure();
        field.check().unwrap();
        let floor = Floor::new(&field, FloorSettings { measure, ..FloorSettings::default() });
        assert_eq!(floor.features(), 1 + LIMBS, "the body and the tips");
        let order = by_importance(&Ranking::Mass.scores(&field, &[]));
        floor.enforce(&order, 5_000, || ())
    }

    #[test]
    fn mass_deletes_the_beads_and_the_floor_brings_them_back() {
        let floored = floored(Measure::Recall);
        assert_eq!((floored.pruned.matched, floored.topology.matched), (1 + LIMBS / 2, 1 + LIMBS));
        assert_eq!(floored.rows.len(), 5_000);
        assert!(floored.restored < 100, "{}", floored.restored);
    }

    #[test]
    fn the_strict_measure_sees_that_fists_are_cut_off() {
        let [paper, strict] = [Measure::Recall, Measure::Strict].map(floored);
        assert_eq!((paper.topology.recall(), strict.topology.recall()), (1.0, 1.0));
        assert!(paper.topology.preserved(Measure::Strict) < 0.8);
        assert!(strict.topology.deepened < paper.topology.deepened);
    }
}
