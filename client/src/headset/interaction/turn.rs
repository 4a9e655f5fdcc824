//! Snap turn: the viewer turns by a step at once, which causes less motion sickness than a smooth turn. The clip
//! turns about the viewer's head.

use super::hands::Pose;
use super::placement::Placement;
use super::stick::Push;

/// Angle of a step in radians.
const STEP: f64 = 30.0 * std::f64::consts::PI / 180.0;

/// `placement` after a push of the stick, for a viewer with the head at `head`; `None` for a push that does
/// not turn.
pub(super) fn snap_turn(placement: &Placement, head: &Pose, push: Push) -> Option<Placement> {
    // As the viewer turns right, the clip moves to the left.
    let angle = match push {
        Push::Right => STEP,
        Push::Left => -STEP,
        Push::Up | Push::Down => return None,
    };
    Some(placement.turned_about(head.position.as_dvec3(), angle))
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3, Quat, Vec3, dvec3};

    use super::super::random::Random;
    use super::*;

    /// Position of the head in the clip, in metres at life size.
    fn head_in_clip(placement: &Placement, head: &Pose) -> DVec3 {
        DQuat::from_rotation_y(-placement.yaw()) * (head.position.as_dvec3() - placement.position())
            / placement.scale()
    }

    #[test]
    fn the_head_keeps_its_place_in_the_clip() {
        let mut random = Random::new(20);
        for _ in 0..200 {
            let (placement, head) = (random.placement(), random.pose());
            let turned = snap_turn(&placement, &head, Push::Right).unwrap();
            assert!(head_in_clip(&placement, &head).distance(head_in_clip(&turned, &head)) < 1e-6);
            assert!((turned.scale() - placement.scale()).abs() < 1e-12);
            let back = snap_turn(&turned, &head, Push::Left).unwrap();
            assert!(back.position().distance(placement.position()) < 1e-9);
        }
    }

    #[test]
    fn turning_right_brings_the_right_side_ahead() {
        let head = Pose { position: Vec3::Y, orientation: Quat::IDENTITY };
        let mut placement = Placement::new(1.0, 0.0, dvec3(2.0, 0.0, 0.0));
        for _ in 0..3 {
            placement = snap_turn(&placement, &head, Push::Right).unwrap();
        }
        assert!(placement.position().distance(dvec3(0.0, 0.0, -2.0)) < 1e-9, "{placement:?}");
        assert_eq!(snap_turn(&placement, &head, Push::Up), None);
    }
}
