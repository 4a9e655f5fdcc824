//! [`Motion`]: the figure's movement over a capture of any length, a chain of blows.
//!
//! The first blow is the same for all captures: its keys are written below. Each further blow takes its keys from
//! pseudorandom numbers seeded by its own number: the place the figure steps to, its heading, the arm that
//! strikes, amplitudes and times. A blow starts in the pose in which the blow before it ends, and every quantity
//! moves along smoothsteps that begin and end within the blow. So position and velocity are continuous.

use std::f64::consts::TAU;

use super::texture::{split_mix, unit};

/// Frames from the start of a blow to the start of the next one.
const BLOW_FRAMES: usize = 32;

/// Index of the left and right side in [`UpperBody::arms`] and [`Stance::legs`].
const LEFT: usize = 0;
const RIGHT: usize = 1;

/// All places lie on rings around this point of the ground (x and z in metres), with radii in this range.
const GROUND_CENTER: [f64; 2] = [0.07, 0.05];
const GROUND_RADIUS: [f64; 2] = [0.08, 0.12];

/// Angles of the figure's joints, in degrees, and the place of its hips, in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) stance: Stance,
    pub(super) upper_body: UpperBody,
    /// How far the stepping leg is lifted, from 0 to 1.
    pub(super) lift: f64,
    /// The leg that steps.
    pub(super) stepping: usize,
}

/// Where the figure stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stance {
    /// x and z of the hips.
    pub(super) place: [f64; 2],
    /// Direction of the figure about the y axis: 0 faces +z, 90 faces +x.
    pub(super) heading: f64,
    pub(super) legs: [Leg; 2],
}

/// A leg: swing about the hip's x axis, negative to the front, and bend of the knee.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leg {
    pub(super) swing: f64,
    pub(super) knee: f64,
}

/// What the upper body does.
#[derive(Clone, Copy, Debug)]
pub(super) struct UpperBody {
    /// Turns about the y axis: of the hips against the heading, of the waist against the hips, of the head against
    /// the waist.
    pub(super) hips: f64,
    pub(super) waist: f64,
    pub(super) head: f64,
    /// Lean of the waist to the front.
    pub(super) lean: f64,
    pub(super) arms: [Arm; 2],
}

/// An arm: swing about the shoulder's x axis, negative to the front and up; turn away from the body; bend of the
/// elbow.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arm {
    pub(super) swing: f64,
    pub(super) out: f64,
    pub(super) elbow: f64,
}

impl Stance {
    fn toward(self, end: Stance, u: f64) -> Stance {
        let leg = |side: usize| Leg {
            swing: between(self.legs[side].swing, end.legs[side].swing, u),
            knee: between(self.legs[side].knee, end.legs[side].knee, u),
        };
        Stance {
            place: [0, 1].map(|axis| between(self.place[axis], end.place[axis], u)),
            heading: between(self.heading, end.heading, u),
            legs: [leg(LEFT), leg(RIGHT)],
        }
    }
}

impl UpperBody {
    fn toward(self, end: UpperBody, u: f64) -> UpperBody {
        let arm = |side: usize| {
            let (a, b) = (self.arms[side], end.arms[side]);
            Arm {
                swing: between(a.swing, b.swing, u),
                out: between(a.out, b.out, u),
                elbow: between(a.elbow, b.elbow, u),
            }
        };
        UpperBody {
            hips: between(self.hips, end.hips, u),
            waist: between(self.waist, end.waist, u),
            head: between(self.head, end.head, u),
            lean: between(self.lean, end.lean, u),
            arms: [arm(LEFT), arm(RIGHT)],
        }
    }
}

/// A step and a blow: how the figure gets from one pose to the next.
#[derive(Clone, Copy, Debug)]
struct Blow {
    /// Where the figure stands at the start and at the end.
    stances: [Stance; 2],
    /// The upper body at the start, wound up, and at the end.
    upper_bodies: [UpperBody; 3],
    /// The leg that steps and the arm that strikes.
    stepping: usize,
    striking: usize,
    /// Start and end of winding up and of striking, as fractions of the blow.
    winding: [f64; 2],
    strike: [f64; 2],
}

/// The movement over a capture.
#[derive(Clone, Debug)]
pub(in crate::synth) struct Motion {
    blows: Vec<Blow>,
    /// Frames from the start of the first blow to its end, at least 1.
    first: usize,
}

impl Motion {
    /// The movement over `frames` frames. Up to 33 frames are one blow from the first frame to the last, at a speed
    /// that depends on their number. Of more frames, the first 33 are the first blow, and another blow starts
    /// at every 32nd frame; the last one is cut where the capture ends.
    pub(in crate::synth) fn new(frames: usize) -> Motion {
        let last = frames.max(2) - 1;
        let mut blows = vec![first_blow()];
        for number in 1..last.div_ceil(BLOW_FRAMES) {
            blows.push(next_blow(number, &blows[number - 1]));
        }
        Motion { blows, first: last.min(BLOW_FRAMES) }
    }

    /// The pose at `frame`, which need not be a whole number, between 0 and the last frame.
    pub(super) fn pose(&self, frame: f64) -> Pose {
        if self.blows.len() == 1 {
            return self.blows[0].pose(frame / self.first as f64);
        }
        let length = BLOW_FRAMES as f64;
        let number = ((frame / length) as usize).min(self.blows.len() - 1);
        self.blows[number].pose((frame - number as f64 * length) / length)
    }
}

impl Blow {
    /// The pose at time `t` in `[0, 1]` from the start to the end of the blow.
    fn pose(&self, t: f64) -> Pose {
        let (step, blow) = (eased(t, [0.05, 0.95]), eased(t, self.strike));
        let [start, wound, end] = self.upper_bodies;
        let mut upper_body = start.toward(wound, eased(t, self.winding)).toward(end, blow);
        // The arm leans outwards, so that it passes the head and the mace stays below the top of the images.
        let flare = 240.0 * blow * (1.0 - blow);
        upper_body.arms[self.striking].out -= flare;
        Pose {
            stance: self.stances[0].toward(self.stances[1], step),
            upper_body,
            // From 0 over 1 back to 0.
            lift: 4.0 * step * (1.0 - step),
            stepping: self.stepping,
        }
    }
}

/// A step forward with the left leg and a blow with the right arm from above, which begins wound up.
fn first_blow() -> Blow {
    let stance = |z: f64, left: f64, right: Leg| Stance {
        place: [0.0, z],
        heading: 0.0,
        legs: [Leg { swing: left, knee: 8.0 }, right],
    };
    let wound = UpperBody {
        hips: -8.0,
        waist: -22.0,
        head: 25.0,
        lean: -6.0,
        arms: [Arm { swing: -35.0, out: 13.0, elbow: -35.0 }, Arm { swing: -165.0, out: 13.0, elbow: -70.0 }],
    };
    let struck = UpperBody {
        hips: 10.0,
        waist: 20.0,
        head: -20.0,
        lean: 13.0,
        arms: [Arm { swing: 25.0, out: 13.0, elbow: -35.0 }, Arm { swing: -35.0, out: 13.0, elbow: -12.0 }],
    };
    Blow {
        stances: [
            stance(-0.2, 16.0, Leg { swing: -18.0, knee: 12.0 }),
            stance(0.2, -24.0, Leg { swing: 20.0, knee: 6.0 }),
        ],
        upper_bodies: [wound, wound, struck],
        stepping: LEFT,
        striking: RIGHT,
        winding: [0.0, 0.3],
        strike: [0.3, 0.7],
    }
}

/// The blow with this number, from 1, which follows `before`.
fn next_blow(number: usize, before: &Blow) -> Blow {
    let mut draws = Draws(split_mix(number as u64));
    let stance = before.stances[1];
    let [striking, stepping] = [(); 2].map(|()| if draws.coin() { LEFT } else { RIGHT });
    let place = {
        let [x, z] = [0, 1].map(|axis| stance.place[axis] - GROUND_CENTER[axis]);
        let angle = libm::atan2(x, z) + TAU * draws.within([0.2, 0.8]);
        let radius = draws.within(GROUND_RADIUS);
        let (sin, cos) = libm::sincos(angle);
        [GROUND_CENTER[0] + radius * sin, GROUND_CENTER[1] + radius * cos]
    };
    let turn = draws.within([20.0, 75.0]) * if draws.coin() { 1.0 } else { -1.0 };
    let mut legs = [Leg { swing: 0.0, knee: 0.0 }; 2];
    legs[stepping] = Leg { swing: draws.within([-24.0, -8.0]), knee: draws.within([6.0, 16.0]) };
    legs[1 - stepping] = Leg { swing: draws.within([8.0, 20.0]), knee: draws.within([4.0, 14.0]) };

    // Turns of the waist are to the other side if the other arm strikes.
    let side = if striking == RIGHT { 1.0 } else { -1.0 };
    let wound_up = Arm {
        swing: draws.within([-170.0, -110.0]),
        out: draws.within([-12.0, 20.0]),
        elbow: draws.within([-115.0, -80.0]),
    };
    let struck = Arm {
        swing: draws.within([-58.0, -15.0]),
        out: draws.within([-5.0, 35.0]),
        elbow: draws.within([-50.0, -18.0]),
    };
    let mut upper_body = |striking_arm: Arm, waist: [f64; 2], lean: [f64; 2]| {
        let other = Arm {
            swing: draws.within([-40.0, 30.0]),
            out: draws.within([8.0, 40.0]),
            elbow: draws.within([-70.0, -15.0]),
        };
        let waist = draws.within(waist);
        UpperBody {
            hips: side * 0.4 * waist,
            waist: side * waist,
            head: -side * waist + draws.within([-15.0, 15.0]),
            lean: draws.within(lean),
            arms: if striking == LEFT { [striking_arm, other] } else { [other, striking_arm] },
        }
    };
    let wound = upper_body(wound_up, [-38.0, -10.0], [-10.0, 4.0]);
    let end = upper_body(struck, [8.0, 36.0], [2.0, 12.0]);
    let wound_at = draws.within([0.36, 0.44]);
    Blow {
        stances: [stance, Stance { place, heading: stance.heading + turn, legs }],
        upper_bodies: [before.upper_bodies[2], wound, end],
        stepping,
        striking,
        winding: [0.0, wound_at],
        strike: [wound_at + draws.within([0.0, 0.06]), draws.within([0.92, 1.0])],
    }
}

/// Pseudorandom numbers from a seed. They need the same values on every machine and in every version, which
/// only an algorithm of our own promises.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(1);
        split_mix(self.0)
    }

    /// Evenly distributed over a range.
    fn within(&mut self, [low, high]: [f64; 2]) -> f64 {
        between(low, high, unit(self.next()))
    }

    fn coin(&mut self) -> bool {
        self.next() >> 63 == 1
    }
}

fn between(start: f64, end: f64, u: f64) -> f64 {
    start + (end - start) * u
}

/// Smoothstep from 0 at `start` to 1 at `end`.
fn eased(t: f64, [start, end]: [f64; 2]) -> f64 {
    let u = ((t - start) / (end - start)).clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::figure::figure;
    use super::*;

    /// Centres of all parts.
    fn centers(motion: &Motion, frame: f64) -> Vec<DVec3> {
        figure(&motion.pose(frame)).iter().map(|part| part.center).collect()
    }

    /// The largest distance between equal parts.
    fn difference(a: &[DVec3], b: &[DVec3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
    }

    #[test]
    fn no_two_seconds_are_alike() {
        let motion = Motion::new(1200);
        let frames: Vec<Vec<DVec3>> = (0..1200).map(|frame| centers(&motion, f64::from(frame))).collect();
        for a in 0..frames.len() {
            for b in a + 30..frames.len() {
                let least = difference(&frames[a], &frames[b]);
                assert!(least > 0.08, "frames {a} and {b}: {least} m");
            }
        }
        let seconds: Vec<&[Vec<DVec3>]> = frames.chunks(30).collect();
        for a in 0..seconds.len() {
            for b in 0..a {
                let most =
                    seconds[a].iter().zip(seconds[b]).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
                assert!(most > 0.4, "seconds {b} and {a}: {most} m");
            }
        }
    }

    #[test]
    fn blows_join_without_a_jump() {
        let motion = Motion::new(1200);
        let steps: Vec<f64> = (0..1199u32)
            .map(|frame| [0, 1].map(|next| centers(&motion, f64::from(frame + next))))
            .map(|[a, b]| difference(&a, &b))
            .collect();
        let fastest = |steps: &[f64]| steps.iter().copied().fold(0.0, f64::max);
        let first = fastest(&steps[..BLOW_FRAMES]);
        assert!(fastest(&steps) <= first, "{} {first}", fastest(&steps));
        let slow = steps[BLOW_FRAMES..].chunks(BLOW_FRAMES).map(fastest).fold(1.0, f64::min);
        assert!(slow > 0.1, "the mace or a fist moves in every blow: {slow}");
        // Velocities of both sides at the joints are 0, and positions meet.
        let near = 1e-3;
        for joint in (BLOW_FRAMES..1199).step_by(BLOW_FRAMES).map(|frame| frame as f64) {
            let [before, at, after] =
                [joint - near, joint, joint + near].map(|frame| centers(&motion, frame));
            for pair in [[&before, &at], [&at, &after]] {
                let speed = difference(pair[0], pair[1]) / near;
                assert!(speed < 0.01, "{speed} m a frame at {joint}");
            }
        }
    }

    /// A capture starts as a longer one does, if it has at least 33 frames.
    #[test]
    fn the_last_blow_is_cut_where_the_capture_ends() {
        let whole = Motion::new(1200);
        for (frames, blows) in [(33, 1), (34, 2), (40, 2), (64, 2), (65, 2), (66, 3)] {
            let motion = Motion::new(frames);
            assert_eq!(motion.blows.len(), blows, "{frames}");
            for frame in (0..frames).map(|frame| frame as f64) {
                // The end of a blow and the start of the next one may round differently.
                let apart = difference(&centers(&motion, frame), &centers(&whole, frame));
                assert!(apart < 1e-12, "{frame} of {frames}: {apart} m");
            }
        }
    }
}
