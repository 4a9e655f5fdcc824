//! The figure in a pose: a person with a mace in the right hand.
//!
//! The figure faces +z, its left is +x, up is +y; lengths are in metres. An unbent limb hangs along -y of its
//! axes.

use glam::{DMat3, DVec3, dvec3};

use super::motion::{Pose, Stance};
use super::solid::Solid;
use super::texture::Texture;

/// A part of the figure at an instant, or of what stands around it.
#[derive(Clone, Copy, Debug)]
pub(in crate::synth) struct FigurePart {
    pub(super) solid: Solid,
    pub(super) texture: Texture,
    /// Centre of the solid.
    pub(super) center: DVec3,
    /// The solid's axes in the world.
    pub(super) axes: DMat3,
}

const CHEST: Texture = Texture::Checks { side: 0.07, colors: [[0.85, 0.25, 0.15], [0.95, 0.80, 0.45]] };
const HIPS: Texture = Texture::Spots { width: 0.06, colors: [[0.20, 0.30, 0.60], [0.75, 0.80, 0.90]] };
const SLEEVE: Texture = Texture::Stripes { width: 0.06, colors: [[0.90, 0.85, 0.80], [0.25, 0.45, 0.75]] };
const SKIN: Texture = Texture::Spots { width: 0.05, colors: [[0.87, 0.64, 0.50], [0.75, 0.50, 0.38]] };
const TROUSERS: Texture = Texture::Checks { side: 0.09, colors: [[0.25, 0.55, 0.35], [0.75, 0.80, 0.40]] };
const BOOT: Texture = Texture::Stripes { width: 0.05, colors: [[0.45, 0.28, 0.15], [0.75, 0.55, 0.35]] };
const SHAFT: Texture = Texture::Stripes { width: 0.08, colors: [[0.55, 0.38, 0.20], [0.90, 0.75, 0.30]] };
const MACE: Texture = Texture::Checks { side: 0.05, colors: [[0.90, 0.90, 0.95], [0.45, 0.20, 0.55]] };

/// Direction of the left and of the right side along x.
const SIDES: [f64; 2] = [1.0, -1.0];

/// The parts in a pose. Their number and order are the same for every pose.
pub(super) fn figure(pose: &Pose) -> Vec<FigurePart> {
    let Pose { stance: Stance { place: [x, z], heading, legs }, upper_body, lift, stepping } = *pose;
    let mut parts = Vec::new();

    let hips = Joint { origin: dvec3(x, 0.90 - 0.03 * lift, z), axes: DMat3::IDENTITY }
        .turned(DVec3::Y, heading + upper_body.hips);
    parts.push(hips.part(dvec3(0.0, 0.0, 0.0), ellipsoid(0.16, 0.13, 0.115), HIPS));
    let waist = hips.turned(DVec3::Y, upper_body.waist).turned(DVec3::X, upper_body.lean);
    parts.push(waist.part(dvec3(0.0, 0.29, 0.0), ellipsoid(0.185, 0.28, 0.12), CHEST));
    let neck = waist.at(dvec3(0.0, 0.55, 0.01));
    parts.push(neck.part(dvec3(0.0, 0.02, 0.0), capsule(0.10, 0.05), SKIN));
    let head = neck.turned(DVec3::Y, upper_body.head);
    parts.push(head.part(dvec3(0.0, 0.17, 0.015), ellipsoid(0.095, 0.125, 0.112), Texture::Face));

    // The last hand is the right one, which holds the mace.
    let mut hand = waist;
    for (side, bend) in SIDES.into_iter().zip(upper_body.arms) {
        let shoulder = waist.at(dvec3(0.205 * side, 0.46, 0.0)).turned(DVec3::Z, bend.out * side);
        hand = arm(&mut parts, shoulder.turned(DVec3::X, bend.swing), bend.elbow);
    }
    let grip = hand.turned(DVec3::X, -60.0);
    parts.push(grip.part(dvec3(0.0, -0.14, 0.0), capsule(0.42, 0.022), SHAFT));
    parts.push(grip.part(dvec3(0.0, -0.40, 0.0), ellipsoid(0.075, 0.09, 0.075), MACE));

    for (number, (side, bend)) in SIDES.into_iter().zip(legs).enumerate() {
        let hip = hips.at(dvec3(0.095 * side, -0.03, 0.0)).turned(DVec3::Z, 3.0 * side);
        let lifted = if number == stepping { 45.0 * lift } else { 0.0 };
        leg(&mut parts, hip.turned(DVec3::X, bend.swing), bend.knee + lifted);
    }
    parts
}

/// Upper arm, forearm and hand; returns the hand.
fn arm(parts: &mut Vec<FigurePart>, shoulder: Joint, elbow_degrees: f64) -> Joint {
    parts.push(shoulder.part(dvec3(0.0, -0.14, 0.0), capsule(0.28, 0.052), SLEEVE));
    let elbow = shoulder.at(dvec3(0.0, -0.28, 0.0)).turned(DVec3::X, elbow_degrees);
    parts.push(elbow.part(dvec3(0.0, -0.12, 0.0), capsule(0.24, 0.043), SKIN));
    let hand = elbow.at(dvec3(0.0, -0.29, 0.0));
    parts.push(hand.part(DVec3::ZERO, ellipsoid(0.045, 0.07, 0.05), SKIN));
    hand
}

fn leg(parts: &mut Vec<FigurePart>, hip: Joint, knee_degrees: f64) {
    parts.push(hip.part(dvec3(0.0, -0.20, 0.0), capsule(0.38, 0.078), TROUSERS));
    let knee = hip.at(dvec3(0.0, -0.41, 0.0)).turned(DVec3::X, knee_degrees);
    parts.push(knee.part(dvec3(0.0, -0.19, 0.0), capsule(0.38, 0.058), TROUSERS));
    let ankle = knee.at(dvec3(0.0, -0.40, 0.0));
    parts.push(ankle.part(dvec3(0.0, -0.02, 0.06), ellipsoid(0.052, 0.05, 0.13), BOOT));
}

/// Position and orientation of a joint.
#[derive(Clone, Copy)]
struct Joint {
    origin: DVec3,
    axes: DMat3,
}

impl Joint {
    /// The same axes at `offset` along them.
    fn at(self, offset: DVec3) -> Joint {
        Joint { origin: self.origin + self.axes * offset, ..self }
    }

    /// Turned about one of its own axes.
    fn turned(self, axis: DVec3, degrees: f64) -> Joint {
        // The system's sine and cosine differ between machines.
        let (sin, cos) = libm::sincos(degrees.to_radians());
        let turn = |v: DVec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
        let turned = DMat3::from_cols(turn(DVec3::X), turn(DVec3::Y), turn(DVec3::Z));
        Joint { axes: self.axes * turned, ..self }
    }

    /// A part centred at `offset`.
    fn part(self, offset: DVec3, solid: Solid, texture: Texture) -> FigurePart {
        FigurePart { solid, texture, center: self.at(offset).origin, axes: self.axes }
    }
}

/// A capsule with `length` between the centres of its round ends.
pub(super) fn capsule(length: f64, radius: f64) -> Solid {
    Solid::Capsule { half: 0.5 * length, radius }
}

pub(super) fn ellipsoid(x: f64, y: f64, z: f64) -> Solid {
    Solid::Ellipsoid { radii: dvec3(x, y, z) }
}

#[cfg(test)]
mod tests {
    use super::super::motion::Motion;
    use super::super::texture::split_mix;
    use super::*;

    /// Reads every position and axis of captures up to 33 frames, whose bytes tests and tables depend on.
    #[test]
    fn short_captures_stay_as_they_are() {
        for (frames, expected) in
            [(1, 0xd12b_0d05_37b9_bce5), (9, 0xf62f_7736_d2fa_a768), (33, 0x1bf1_4d0f_c382_02a0)]
        {
            let motion = Motion::new(frames);
            let parts = (0..frames).flat_map(|frame| figure(&motion.pose(frame as f64)));
            let numbers = parts.flat_map(|part| {
                [part.center.to_array().to_vec(), part.axes.to_cols_array().to_vec()].concat()
            });
            let sum = numbers.fold(0, |sum, x| split_mix(sum ^ x.to_bits()));
            assert_eq!(sum, expected, "{frames} frames: {sum:#x}");
        }
    }

    #[test]
    fn the_figure_is_as_large_as_a_person_and_strikes() {
        let motion = Motion::new(33);
        let figures: Vec<Vec<FigurePart>> =
            (0..33).map(|frame| figure(&motion.pose(f64::from(frame)))).collect();
        for parts in &figures {
            let head = parts[3].center.y + 0.125;
            let sole =
                parts.iter().map(|part| part.center.y - part.solid.bounding_radius()).fold(1.0, f64::min);
            assert!((1.6..1.8).contains(&head) && (-0.2..0.15).contains(&sole), "{head} {sole}");
            for part in parts {
                let turns = part.axes.transpose() * part.axes - DMat3::IDENTITY;
                assert!(turns.to_cols_array().iter().all(|x| x.abs() < 1e-12));
                assert!(part.center.length() < 2.3);
            }
        }
        let moved = |part: usize| -> Vec<f64> {
            figures.windows(2).map(|pair| pair[0][part].center.distance(pair[1][part].center)).collect()
        };
        // Chest and mace.
        let (chest, mace) = (moved(1), moved(11));
        let sum = |steps: &[f64]| steps.iter().sum::<f64>();
        assert!((0.3..0.7).contains(&sum(&chest)) && sum(&mace) > 2.0, "{} {}", sum(&chest), sum(&mace));
        let swift = mace.iter().fold(0.0, |most: f64, step| most.max(*step));
        assert!(swift > 0.15 && mace[0] < 0.01 && mace[31] < 0.01, "{swift}");
    }
}
