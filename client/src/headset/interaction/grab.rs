//! [`Grab`]: hands that hold the clip.
//!
//! One hand carries the clip like a statue on a pole: the clip moves with the hand and turns with it about the
//! vertical, but never tilts. Two hands carry, turn and scale it: the point midway between them stays midway.
//! When the holding hands change, or something else moves the clip, the motion restarts from the present
//! poses, so that nothing jumps.

use glam::{DQuat, DVec2, DVec3};

use super::hands::{Pose, Side};
use super::haptics::{Haptics, Pulse};
use super::placement::Placement;

/// Distance between two hands, in metres, below which their direction and the ratio of distances are noise.
const HANDS_APART_M: f64 = 0.05;

/// Swing of a hand since it took hold, as the squared cosine of half the angle (a right angle), from which it
/// takes hold again: near half a turn, its turn about the vertical is undefined.
const SWUNG: f64 = 0.5;

/// State of the holding hands.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Grab {
    hold: Hold,
    /// Placement after the last frame.
    placement: Placement,
}

/// Poses when the hands took hold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Hold {
    #[default]
    Nothing,
    One {
        side: Side,
        hand: Pose,
        placement: Placement,
    },
    Two {
        center: DVec3,
        apart_m: f64,
        placement: Placement,
        /// Level direction from left to right, in the last frame with a defined one.
        level: Option<DVec2>,
        /// Angle about +y by which the hands have turned the clip.
        turned: f64,
    },
}

impl Hold {
    fn new(hands: [Option<Pose>; 2], placement: Placement) -> Hold {
        match hands {
            [None, None] => Hold::Nothing,
            [Some(hand), None] => Hold::One { side: Side::Left, hand, placement },
            [None, Some(hand)] => Hold::One { side: Side::Right, hand, placement },
            [Some(left), Some(right)] => {
                let Span { center, apart_m, level } = Span::new(left, right);
                Hold::Two { center, apart_m, placement, level, turned: 0.0 }
            }
        }
    }

    fn holds(&self, side: Side) -> bool {
        match *self {
            Hold::Nothing => false,
            Hold::One { side: holding, .. } => holding == side,
            Hold::Two { .. } => true,
        }
    }
}

/// The line between two hands.
struct Span {
    center: DVec3,
    apart_m: f64,
    /// Level direction from left to right, x and z; `None` if one hand is above the other.
    level: Option<DVec2>,
}

impl Span {
    fn new(left: Pose, right: Pose) -> Span {
        let (left, right) = (left.position.as_dvec3(), right.position.as_dvec3());
        let level = DVec2::new(right.x - left.x, right.z - left.z);
        Span {
            center: left.midpoint(right),
            apart_m: left.distance(right).max(HANDS_APART_M),
            level: (level.length() >= HANDS_APART_M).then(|| level.normalize()),
        }
    }
}

impl Grab {
    /// Placement of a clip at `placement` after a frame with the grip poses `hands`, left then right, `None` for
    /// a hand that holds nothing. Taking hold and releasing give pulses.
    pub(super) fn update(
        &mut self,
        hands: [Option<Pose>; 2],
        placement: Placement,
        haptics: &mut Haptics,
    ) -> Placement {
        for side in Side::BOTH {
            match (self.hold.holds(side), hands[side as usize].is_some()) {
                (false, true) => haptics.play(side, Pulse::GRAB),
                (true, false) => haptics.play(side, Pulse::RELEASE),
                _ => {}
            }
        }
        let same_hands = Side::BOTH.map(|side| self.hold.holds(side)) == hands.map(|hand| hand.is_some());
        if !same_hands || placement != self.placement {
            self.hold = Hold::new(hands, placement);
        }
        self.placement = self.carry(hands).unwrap_or(placement);
        self.placement
    }

    /// Whether any hand holds the clip.
    pub(super) fn is_holding(&self) -> bool {
        self.hold != Hold::Nothing
    }

    /// `None` if no hand holds.
    fn carry(&mut self, hands: [Option<Pose>; 2]) -> Option<Placement> {
        match (&mut self.hold, hands) {
            (Hold::One { hand: start, placement, .. }, [Some(hand), None] | [None, Some(hand)]) => {
                let turn = hand.orientation.as_dquat() * start.orientation.as_dquat().inverse();
                let (angle, upright) = turn_about_up(turn);
                let (from, to) = (start.position.as_dvec3(), hand.position.as_dvec3());
                let carried = placement.carried(from, to, angle, placement.scale());
                if upright < SWUNG {
                    (*start, *placement) = (hand, carried);
                }
                Some(carried)
            }
            (Hold::Two { center, apart_m, placement, level, turned }, [Some(left), Some(right)]) => {
                let span = Span::new(left, right);
                if let (Some(before), Some(now)) = (*level, span.level) {
                    // The angle about +y goes from z to x.
                    *turned += now.perp_dot(before).atan2(now.dot(before));
                }
                *level = span.level;
                let scale = placement.scale() * (span.apart_m / *apart_m);
                Some(placement.carried(*center, span.center, *turned, scale))
            }
            _ => None,
        }
    }
}

/// Angle in radians of a rotation's turn about +y, and the squared cosine of half the angle by which its rest
/// swings the vertical.
fn turn_about_up(rotation: DQuat) -> (f64, f64) {
    (2.0 * rotation.y.atan2(rotation.w), rotation.y * rotation.y + rotation.w * rotation.w)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use glam::{Quat, Vec3, dvec3, vec3};

    use super::super::random::Random;
    use super::*;

    /// Feeds frames and holds the placement, as a session does.
    struct Bench {
        grab: Grab,
        placement: Placement,
        haptics: Haptics,
    }

    impl Bench {
        fn new(placement: Placement) -> Bench {
            Bench { grab: Grab::default(), placement, haptics: Haptics::default() }
        }

        fn hold(&mut self, hands: [Option<Pose>; 2]) -> Placement {
            self.haptics = Haptics::default();
            self.placement = self.grab.update(hands, self.placement, &mut self.haptics);
            self.placement
        }
    }

    fn at(position: Vec3) -> Pose {
        Pose { position, orientation: Quat::IDENTITY }
    }

    /// Position in the stage of a point of the clip, upright and in metres.
    fn stage(placement: &Placement, point: DVec3) -> DVec3 {
        DQuat::from_rotation_y(placement.yaw()) * point * placement.scale() + placement.position()
    }

    /// Inverse of [`stage`].
    fn clip(placement: &Placement, point: DVec3) -> DVec3 {
        DQuat::from_rotation_y(-placement.yaw()) * (point - placement.position()) / placement.scale()
    }

    fn near(a: &Placement, b: &Placement, tolerance: f64) -> bool {
        let turn = (a.yaw() - b.yaw() + PI).rem_euclid(2.0 * PI) - PI;
        a.position().distance(b.position()) < tolerance
            && turn.abs() < tolerance
            && (a.scale() / b.scale() - 1.0).abs() < tolerance
    }

    #[test]
    fn one_hand_moves_and_turns_it_as_one_body() {
        let mut random = Random::new(10);
        for _ in 0..300 {
            let mut bench = Bench::new(random.placement());
            let hand = random.pose();
            let start = bench.hold([None, Some(hand)]);
            assert!(near(&start, &bench.placement, 1e-12), "taking hold moves nothing");
            let held = clip(&start, hand.position.as_dvec3());
            let angle = random.signed() * PI;
            let moved = Pose {
                position: random.point().as_vec3(),
                orientation: Quat::from_rotation_y(angle as f32) * hand.orientation,
            };
            let end = bench.hold([None, Some(moved)]);
            assert!(stage(&end, held).distance(moved.position.as_dvec3()) < 1e-5);
            let expected = Placement::new(start.scale(), start.yaw() + angle, end.position());
            assert!(near(&end, &expected, 1e-5), "{end:?} {expected:?}");
        }
    }

    #[test]
    fn a_hand_that_tilts_does_not_tilt_or_turn_it() {
        let mut bench = Bench::new(Placement::new(1.0, 0.4, dvec3(0.0, 0.0, -2.0)));
        let start = bench.hold([Some(at(Vec3::Y)), None]);
        for pitch in 1..=30 {
            let orientation = Quat::from_rotation_x(pitch as f32 * 0.1);
            let held = bench.hold([Some(Pose { position: Vec3::Y, orientation }), None]);
            assert!(near(&held, &start, 1e-5), "{held:?}");
        }
    }

    #[test]
    fn small_motions_of_any_hand_are_small_motions_of_the_clip() {
        let mut random = Random::new(11);
        for _ in 0..50 {
            let mut bench = Bench::new(Placement::new(1.0, 0.0, dvec3(0.0, 0.0, -1.0)));
            let mut hand = at(vec3(0.2, 1.0, -0.3));
            let axis = random.point().normalize().as_vec3();
            bench.hold([None, Some(hand)]);
            for _ in 0..400 {
                let before = bench.placement;
                // More than six turns about a random axis.
                hand.orientation = (Quat::from_axis_angle(axis, 0.1) * hand.orientation).normalize();
                let after = bench.hold([None, Some(hand)]);
                let turn = (after.yaw() - before.yaw() + PI).rem_euclid(2.0 * PI) - PI;
                assert!(turn.abs() < 0.35, "{turn} about {axis}");
            }
        }
    }

    #[test]
    fn hands_twice_as_far_apart_make_it_twice_as_large() {
        let mut bench = Bench::new(Placement::default());
        bench.hold([Some(at(vec3(-0.2, 1.0, 0.0))), Some(at(vec3(0.2, 1.0, 0.0)))]);
        let end = bench.hold([Some(at(vec3(-0.4, 1.0, 0.0))), Some(at(vec3(0.4, 1.0, 0.0)))]);
        assert!((end.scale() - 2.0).abs() < 1e-6 && end.yaw().abs() < 1e-9, "{end:?}");
        // What was between the hands, a metre above the ground, still is.
        assert!(end.position().distance(dvec3(0.0, -1.0, 0.0)) < 1e-6, "{end:?}");
    }

    #[test]
    fn two_hands_turn_it_the_way_they_turn() {
        let mut bench = Bench::new(Placement::default());
        bench.hold([Some(at(Vec3::NEG_X)), Some(at(Vec3::X))]);
        // The right hand goes ahead, the left one back: a turn to the left, seen from above.
        for step in 1..=18 {
            let angle = FRAC_PI_2 as f32 * step as f32 / 18.0;
            let right = Quat::from_rotation_y(angle) * Vec3::X;
            bench.hold([Some(at(-right)), Some(at(right))]);
        }
        assert!((bench.placement.yaw() - FRAC_PI_2).abs() < 1e-5, "{:?}", bench.placement);
        // The right hand is now ahead, at -z; what was at +x in the clip is there too.
        assert!(stage(&bench.placement, DVec3::X).distance(DVec3::NEG_Z) < 1e-5);
    }

    #[test]
    fn what_is_between_two_hands_stays_there() {
        let mut random = Random::new(12);
        for _ in 0..300 {
            let mut bench = Bench::new(random.placement());
            let (left, right) = (random.pose(), random.pose());
            let start = bench.hold([Some(left), Some(right)]);
            let center = |l: Pose, r: Pose| l.position.as_dvec3().midpoint(r.position.as_dvec3());
            let held = clip(&start, center(left, right));
            for _ in 0..5 {
                let (left, right) = (random.pose(), random.pose());
                let end = bench.hold([Some(left), Some(right)]);
                let error = stage(&end, held).distance(center(left, right));
                assert!(error < 1e-5, "{error}: {end:?}");
                assert!((0.05..=20.0).contains(&end.scale()));
            }
        }
    }

    #[test]
    fn hands_above_each_other_do_not_spin_it() {
        let mut bench = Bench::new(Placement::default());
        bench.hold([Some(at(vec3(0.0, 0.5, 0.0))), Some(at(vec3(0.0, 1.5, 0.0)))]);
        for jitter in [1e-3, -1e-3, 0.0, 2e-3] {
            let end = bench.hold([Some(at(vec3(jitter, 0.5, 0.0))), Some(at(vec3(0.0, 1.5, -jitter)))]);
            assert!(end.yaw().abs() < 1e-9 && (end.scale() - 1.0).abs() < 1e-4, "{end:?}");
        }
    }

    #[test]
    fn changing_hands_moves_nothing() {
        let mut random = Random::new(13);
        for _ in 0..100 {
            let mut bench = Bench::new(random.placement());
            for _ in 0..20 {
                let (left, right) = (random.pose(), random.pose());
                let choice = |random: &mut Random, pose| (random.signed() > 0.0).then_some(pose);
                let hands = [choice(&mut random, left), choice(&mut random, right)];
                bench.hold(hands);
                // Other hands at the same instant.
                let before = bench.placement;
                let others = if hands[0].is_some() { [None, Some(right)] } else { [Some(left), Some(right)] };
                if others.map(|hand| hand.is_some()) != hands.map(|hand| hand.is_some()) {
                    assert!(near(&bench.hold(others), &before, 1e-9));
                }
            }
        }
    }

    #[test]
    fn something_else_may_move_it_meanwhile() {
        let mut bench = Bench::new(Placement::default());
        bench.hold([None, Some(at(Vec3::Y))]);
        bench.placement = bench.placement.turned_about(DVec3::X, 0.5);
        let turned = bench.placement;
        assert!(near(&bench.hold([None, Some(at(Vec3::Y))]), &turned, 1e-12));
        let moved = bench.hold([None, Some(at(Vec3::Y + Vec3::Z))]);
        assert!(moved.position().distance(turned.position() + DVec3::Z) < 1e-9);
    }

    #[test]
    fn hands_in_one_place_give_numbers() {
        let mut bench = Bench::new(Placement::default());
        let hand = at(Vec3::Y);
        for hands in [[Some(hand), Some(hand)], [None, None], [Some(hand), Some(at(vec3(0.0, 1.0, 40.0)))]] {
            bench.hold(hands);
            bench.hold([Some(hand), Some(hand)]);
            assert!(bench.placement.position().is_finite() && bench.placement.scale() > 0.0);
        }
        bench.hold([None, None]);
        assert!(!bench.grab.is_holding());
    }

    #[test]
    fn taking_hold_and_letting_go_are_felt_by_the_hand_that_does() {
        let mut bench = Bench::new(Placement::default());
        let hand = Some(at(Vec3::Y));
        for (hands, felt) in [
            ([None, hand], [None, Some(Pulse::GRAB)]),
            ([None, hand], [None, None]),
            ([hand, hand], [Some(Pulse::GRAB), None]),
            ([hand, None], [None, Some(Pulse::RELEASE)]),
            ([None, None], [Some(Pulse::RELEASE), None]),
        ] {
            bench.hold(hands);
            assert_eq!(Side::BOTH.map(|side| bench.haptics.on(side)), felt);
        }
    }
}
