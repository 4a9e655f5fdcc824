//! [`PointerRay`]: the visible line from a hand to its target.

use glam::{Mat3, Quat, Vec2, Vec3};

use crate::headset::interaction::Pose;

const WIDTH_M: f32 = 0.004;

/// Gap between the hand and the start of the line, so that it does not stick in the controller.
const START_M: f32 = 0.05;

/// Length of the line of a hand that points away from the panel.
const FREE_M: f32 = 0.4;

/// A narrow quad, turned about its length towards the eyes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointerRay {
    /// Pose of its center, with y along it, away from the hand.
    pose: Pose,
    length_m: f32,
}

impl PointerRay {
    /// The ray of a hand with the pose `aim`, for eyes at `eye`, up to a target at `distance_m` if there is
    /// one. `None` if the target is too near.
    pub(super) fn new(aim: &Pose, distance_m: Option<f32>, eye: Vec3) -> Option<PointerRay> {
        let length_m = distance_m.map_or(FREE_M, |distance_m| distance_m - START_M);
        let along = aim.forward();
        let center = aim.position + along * (START_M + 0.5 * length_m);
        let to_eye = (eye - center).reject_from_normalized(along);
        // Seen along its length, any turn will do.
        let normal = if to_eye.length() > 1e-3 { to_eye.normalize() } else { along.any_orthonormal_vector() };
        let orientation = Quat::from_mat3(&Mat3::from_cols(along.cross(normal), along, normal));
        let pose = Pose { position: center, orientation };
        (length_m > WIDTH_M && pose.is_valid()).then_some(PointerRay { pose, length_m })
    }

    /// Pose of the quad layer: the center, with +z to the viewer.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Width and length in metres.
    pub fn size_m(&self) -> Vec2 {
        Vec2::new(WIDTH_M, self.length_m)
    }
}

#[cfg(test)]
mod tests {
    use glam::vec3;

    use super::*;

    const EYE: Vec3 = Vec3::new(0.0, 1.6, 0.0);

    fn aim() -> Pose {
        Pose { position: vec3(0.3, 1.1, -0.2), orientation: Quat::from_rotation_x(0.3) }
    }

    #[test]
    fn it_lies_on_the_ray_and_ends_where_that_does() {
        let aim = aim();
        let ends = |distance_m| {
            let ray = PointerRay::new(&aim, distance_m, EYE).unwrap();
            let half = ray.pose().orientation * (0.5 * ray.size_m().y * Vec3::Y);
            [ray.pose().position - half, ray.pose().position + half]
        };
        for (distance_m, end_m) in [(Some(1.2), 1.2), (None, START_M + FREE_M)] {
            let [start, end] = ends(distance_m);
            assert!(start.distance(aim.position + START_M * aim.forward()) < 1e-5);
            assert!(end.distance(aim.position + end_m * aim.forward()) < 1e-5);
        }
    }

    #[test]
    fn it_turns_its_face_to_the_eyes() {
        let ray = PointerRay::new(&aim(), Some(1.0), EYE).unwrap();
        let to_eye = (EYE - ray.pose().position).normalize();
        let normal = ray.pose().orientation * Vec3::Z;
        let along = ray.pose().orientation * Vec3::Y;
        assert!((normal.dot(to_eye) - to_eye.reject_from(along).length()).abs() < 1e-5, "no turn is better");
    }

    #[test]
    fn what_is_no_line_is_none() {
        assert_eq!(PointerRay::new(&aim(), Some(0.04), EYE), None, "the hand is on the panel");
        assert_eq!(PointerRay::new(&Pose { position: Vec3::NAN, ..aim() }, None, EYE), None);
        let from_the_eye = Pose { position: EYE, ..aim() };
        assert!(PointerRay::new(&from_the_eye, None, EYE).unwrap().pose().is_valid());
    }
}
