//! The three-ball cascade: positions of balls and hands, and sway of the body.
//!
//! Throw `n` leaves hand `n % 2` at beat `n` with ball `n % 3`, flies a parabola to the other hand
//! and is thrown again three beats later. A hand swings with the ball from the catch, outside, to
//! the throw, inside, and returns on its own; its velocity is the ball's at both ends, so that no
//! path has a kink. Gravity is a slow-motion film's. Clip time `t` is periodic: 0 and 1 are
//! the same instant.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, dvec3};

use super::light::{Albedo, soft, srgb};

/// Number of balls.
pub(super) const BALLS: usize = 3;

/// Radius of a ball in metres.
pub(super) const BALL_RADIUS: f64 = 0.042;

/// Throws in the clip: the fewest after which every ball is back in its first hand.
const BEATS: f64 = 6.0;

/// Time in the air, in beats.
const FLIGHT: f64 = 2.0;

/// Time in a hand, in beats.
const DWELL: f64 = BALLS as f64 - FLIGHT;

/// Height of a throw above the hands in metres.
const HEIGHT: f64 = 0.28;

/// Offset of the ball's centre from the centre of the palm.
const PALM: DVec3 = DVec3::new(0.0, 0.055, 0.0);

/// Sway of the body at clip time `t`, in `[-1, 1]`: the only cubic, up to its size, that passes
/// from the end of the clip to its start without a jump or a kink (the third Bernoulli
/// polynomial), close to a sine.
pub(super) fn sway(t: f64) -> f64 {
    let t = t.rem_euclid(1.0);
    t * (t - 0.5) * (t - 1.0) * 12.0 * 3f64.sqrt()
}

/// The pattern.
pub(super) struct Cascade {
    /// Throwing position of each hand.
    throws: [DVec3; 2],
    /// Catching position of each hand.
    catches: [DVec3; 2],
}

impl Cascade {
    pub(super) fn new() -> Cascade {
        let sides = [1.0, -1.0];
        Cascade {
            throws: sides.map(|x| dvec3(0.13 * x, 1.18, 0.37)),
            catches: sides.map(|x| dvec3(0.32 * x, 1.18, 0.33)),
        }
    }

    /// Palms in the rest pose.
    pub(super) fn rest(&self) -> [DVec3; 2] {
        [0, 1].map(|side| 0.5 * (self.throws[side] + self.catches[side]) - PALM)
    }

    /// The palms at clip time `t`, left hand (+x) first.
    pub(super) fn hands(&self, t: f64) -> [DVec3; 2] {
        [0, 1].map(|side| self.hand_path(side, t * BEATS) - PALM)
    }

    /// Centre of a ball at clip time `t`.
    pub(super) fn ball(&self, ball: usize, t: f64) -> DVec3 {
        let beat = t * BEATS;
        let (hand, since) = self.last_throw(ball, beat);
        if since >= FLIGHT {
            return self.hand_path(1 - hand, beat);
        }
        let u = since / FLIGHT;
        let rise = dvec3(0.0, 4.0 * HEIGHT * u * (1.0 - u), 0.0);
        self.throws[hand].lerp(self.catches[1 - hand], u) + rise
    }

    /// Rotation of a ball at clip time `t`: half a turn in each flight.
    pub(super) fn rotation(&self, ball: usize, t: f64) -> DQuat {
        let beat = t * BEATS;
        let (hand, since) = self.last_throw(ball, beat);
        let u = (since / FLIGHT).min(1.0);
        let turns = 0.5 * (u * u * (3.0 - 2.0 * u) + hand as f64);
        DQuat::from_axis_angle(dvec3(0.6, 0.2, 0.77).normalize(), 2.0 * PI * turns)
    }

    /// The hand that threw a ball last, and the beats since.
    fn last_throw(&self, ball: usize, beat: f64) -> (usize, f64) {
        let balls = BALLS as f64;
        let round = ((beat - ball as f64) / balls).floor();
        let throw = ball as f64 + round * balls;
        (throw.rem_euclid(2.0) as usize, beat - throw)
    }

    /// Position of a ball held in the hand on this side.
    fn hand_path(&self, side: usize, beat: f64) -> DVec3 {
        let (throw, catch) = (self.throws[side], self.catches[side]);
        let up = dvec3(0.0, 4.0 * HEIGHT / FLIGHT, 0.0);
        let leaving = (self.catches[1 - side] - throw) / FLIGHT + up;
        let arriving = (catch - self.throws[1 - side]) / FLIGHT - up;
        let since = (beat - side as f64).rem_euclid(2.0);
        let empty = 2.0 - DWELL;
        if since < empty {
            hermite(throw, leaving, catch, arriving, empty, since / empty)
        } else {
            hermite(catch, arriving, throw, leaving, DWELL, (since - empty) / DWELL)
        }
    }
}

/// The cubic from `a` to `b` with velocities `va` and `vb` that takes `duration`, at `u` in
/// `[0, 1]`.
fn hermite(a: DVec3, va: DVec3, b: DVec3, vb: DVec3, duration: f64, u: f64) -> DVec3 {
    let (u2, u3) = (u * u, u * u * u);
    a * (2.0 * u3 - 3.0 * u2 + 1.0)
        + va * duration * (u3 - 2.0 * u2 + u)
        + b * (3.0 * u2 - 2.0 * u3)
        + vb * duration * (u3 - u2)
}

/// A cream band around a ball of its own colour.
pub(super) fn paint(ball: usize, normal: DVec3) -> Albedo {
    let colors = [srgb(0xe8433a), srgb(0xf2b233), srgb(0x2f7fd6)];
    colors[ball].lerp(srgb(0xfff1d6), soft(0.26 - normal.x.abs(), 0.25))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_join_without_jump_or_kink() {
        let cascade = Cascade::new();
        let paths: [&dyn Fn(f64) -> DVec3; 6] = [
            &|t| cascade.ball(0, t),
            &|t| cascade.ball(1, t),
            &|t| cascade.ball(2, t),
            &|t| cascade.hands(t)[0],
            &|t| cascade.hands(t)[1],
            &|t| DVec3::splat(sway(t)),
        ];
        let h = 1e-5;
        for (i, path) in paths.iter().enumerate() {
            assert!((path(0.0) - path(1.0)).length() < 1e-9, "path {i} loops");
            for step in 0..4000 {
                let t = f64::from(step) / 4000.0;
                let before = (path(t) - path(t - h)) / h;
                let after = (path(t + h) - path(t)) / h;
                // Nothing accelerates by more than 400 m per clip^2.
                assert!((after - before).length() < 400.0 * h, "path {i} has a kink at {t}");
            }
        }
    }

    #[test]
    fn a_ball_in_the_hand_stays_in_it_and_balls_never_meet() {
        let cascade = Cascade::new();
        for step in 0..600 {
            let t = f64::from(step) / 600.0;
            let balls = [0, 1, 2].map(|ball| cascade.ball(ball, t));
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                assert!((balls[a] - balls[b]).length() > 2.0 * BALL_RADIUS, "balls {a} and {b} at {t}");
            }
            let hands = cascade.hands(t);
            let held =
                balls.iter().filter(|ball| hands.iter().any(|hand| (**ball - *hand - PALM).length() < 1e-9));
            assert!(held.count() <= 2);
        }
    }
}
