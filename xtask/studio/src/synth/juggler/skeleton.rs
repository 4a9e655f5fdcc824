//! The articulated body: a pose from the sway of the hips and the positions of the palms.
//!
//! Arms and legs are solved from their ends (two bones, one hinge); the feet never leave the
//! floor. The left side (+x) comes first in every pair.

use glam::{DMat3, DQuat, DVec3, dvec3};

/// A bone, as an index into a pose.
pub(super) type Bone = usize;

pub(super) const PELVIS: Bone = 0;
pub(super) const CHEST: Bone = 1;
pub(super) const HEAD: Bone = 2;
pub(super) const UPPER_ARM: [Bone; 2] = [3, 9];
pub(super) const FOREARM: [Bone; 2] = [4, 10];
pub(super) const HAND: [Bone; 2] = [5, 11];
pub(super) const THIGH: [Bone; 2] = [6, 12];
pub(super) const SHIN: [Bone; 2] = [7, 13];
pub(super) const FOOT: [Bone; 2] = [8, 14];

/// Number of bones.
const BONES: usize = 15;

/// Parent of each bone; the pelvis is its own.
const PARENTS: [Bone; BONES] =
    [PELVIS, PELVIS, CHEST, CHEST, 3, 4, PELVIS, 6, 7, CHEST, 9, 10, PELVIS, 12, 13];

const UPPER_ARM_LENGTH: f64 = 0.29;
const FOREARM_LENGTH: f64 = 0.26;
const THIGH_LENGTH: f64 = 0.42;
const SHIN_LENGTH: f64 = 0.415;

/// Offset of the centre of the palm from the wrist.
const HAND_LENGTH: f64 = 0.075;

/// Origin and rotation of a bone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) origin: DVec3,
    pub(super) rotation: DQuat,
}

impl Frame {
    /// The point at `offset` along the bone's axes.
    pub(super) fn at(&self, x: f64, y: f64, z: f64) -> DVec3 {
        self.origin + self.rotation * dvec3(x, y, z)
    }
}

/// One frame per bone. A limb's bone lies along its x axis; the others have the world's axes when
/// at rest.
pub(super) type Pose = [Frame; BONES];

/// Transform of each bone from the rest pose to another: rotation, then translation.
pub(super) type Motion = [(DQuat, DVec3); BONES];

/// The pose with the hips swayed by `sway` in `[-1, 1]` and the palms at `palms`.
pub(super) fn pose(sway: f64, palms: [DVec3; 2]) -> Pose {
    let degrees = |angle: f64| (angle * sway).to_radians();
    let pelvis = Frame {
        origin: dvec3(0.04 * sway, 0.91, 0.0),
        rotation: DQuat::from_rotation_z(degrees(-2.5)) * DQuat::from_rotation_y(degrees(4.0)),
    };
    let chest = Frame {
        origin: pelvis.at(0.0, 0.14, 0.0),
        rotation: DQuat::from_rotation_z(degrees(3.5)) * DQuat::from_rotation_y(degrees(-5.0)),
    };
    let head = Frame {
        origin: chest.at(0.0, 0.38, 0.0),
        rotation: DQuat::from_rotation_y(degrees(13.0)) * DQuat::from_rotation_z(degrees(-5.0)),
    };
    let mut pose = [pelvis; BONES];
    pose[CHEST] = chest;
    pose[HEAD] = head;
    for (side, x) in [1.0, -1.0].into_iter().enumerate() {
        // Palms stay level and point a little inwards.
        let hand = DQuat::from_rotation_y(f64::to_radians(-90.0 - 14.0 * x));
        let wrist = palms[side] - hand * DVec3::X * HAND_LENGTH;
        let shoulder = chest.at(0.175 * x, 0.315, -0.01);
        let pole = dvec3(0.55 * x, -1.0, -0.45);
        let arm = bend(shoulder, wrist, [UPPER_ARM_LENGTH, FOREARM_LENGTH], pole);
        pose[UPPER_ARM[side]] = arm[0];
        pose[FOREARM[side]] = arm[1];
        pose[HAND[side]] = Frame { origin: arm[1].at(FOREARM_LENGTH, 0.0, 0.0), rotation: hand };
        let hip = pelvis.at(0.085 * x, -0.01, 0.0);
        let ankle = dvec3(0.135 * x, 0.09, -0.03);
        let leg = bend(hip, ankle, [THIGH_LENGTH, SHIN_LENGTH], dvec3(0.35 * x, 0.0, 1.0));
        pose[THIGH[side]] = leg[0];
        pose[SHIN[side]] = leg[1];
        let toes = DQuat::from_rotation_y(f64::to_radians(24.0 * x));
        pose[FOOT[side]] = Frame { origin: ankle, rotation: toes };
    }
    pose
}

/// Two bones of the given lengths from `root` to `end`, their joint towards `pole`; stretched
/// if the end is too far.
fn bend(root: DVec3, end: DVec3, [first, second]: [f64; 2], pole: DVec3) -> [Frame; 2] {
    let direction = (end - root).normalize();
    let distance = (end - root).length().clamp((first - second).abs() + 1e-6, first + second - 1e-6);
    let side = pole.reject_from_normalized(direction).normalize();
    let along = (first * first - second * second + distance * distance) / (2.0 * distance);
    let joint = root + direction * along + side * (first * first - along * along).max(0.0).sqrt();
    let hinge = direction.cross(side);
    let frame = |origin: DVec3, towards: DVec3| {
        let x = (towards - origin).normalize();
        Frame { origin, rotation: DQuat::from_mat3(&DMat3::from_cols(x, hinge.cross(x), hinge)) }
    };
    [frame(root, joint), frame(joint, root + direction * distance)]
}

/// The transforms from pose `rest` to pose `to`.
pub(super) fn motion(rest: &Pose, to: &Pose) -> Motion {
    std::array::from_fn(|bone| {
        let rotation = to[bone].rotation * rest[bone].rotation.inverse();
        (rotation, to[bone].origin - rotation * rest[bone].origin)
    })
}

/// Whether two bones meet in a joint.
pub(super) fn joined(a: Bone, b: Bone) -> bool {
    a == b || PARENTS[a] == b || PARENTS[b] == a
}

/// Linear blend skinning: image of `point` of the figure at rest, and the rotation there. `skin` holds
/// bones and weights that sum to 1.
pub(super) fn skinned(motion: &Motion, skin: &[(Bone, f64)], point: DVec3) -> (DQuat, DVec3) {
    let first = motion[skin[0].0].0;
    let mut position = DVec3::ZERO;
    let mut turn = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    for &(bone, weight) in skin {
        let (rotation, translation) = motion[bone];
        position += weight * (rotation * point + translation);
        turn += rotation * (weight * rotation.dot(first).signum());
    }
    (turn.normalize(), position)
}

#[cfg(test)]
mod tests {
    use super::super::cascade::{Cascade, sway};
    use super::*;

    #[test]
    fn hands_reach_the_balls_and_feet_stay() {
        let cascade = Cascade::new();
        let rest = pose(0.0, cascade.rest());
        for step in 0..200 {
            let t = f64::from(step) / 200.0;
            let pose = pose(sway(t), cascade.hands(t));
            for side in 0..2 {
                let palm = pose[HAND[side]].at(HAND_LENGTH, 0.0, 0.0);
                assert!((palm - cascade.hands(t)[side]).length() < 1e-9, "hand {side} at {t}");
                let knee = pose[THIGH[side]].at(THIGH_LENGTH, 0.0, 0.0);
                assert!((knee - pose[SHIN[side]].origin).length() < 1e-9);
                let ankle = pose[SHIN[side]].at(SHIN_LENGTH, 0.0, 0.0);
                assert!((ankle - rest[FOOT[side]].origin).length() < 1e-9, "foot {side} at {t}");
            }
        }
    }
}
