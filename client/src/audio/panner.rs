//! [`pan`]: how loud and how late a source is at either ear, and [`Placing`], which applies it to samples.
//!
//! The level difference is an equal-power pan, the time difference that of a spherical head (Woodworth: r / c (a + sin a)),
//! and the level falls with distance. Directions in front and behind sound the same; a head-related transfer function
//! would tell them apart.

use glam::DVec3;

use super::packets::Frame;

/// Radius of a head in metres, and the speed of sound in metres a second.
const HEAD_RADIUS_M: f64 = 0.0875;
const SPEED_M_S: f64 = 343.0;

/// Distance up to which a source is as loud as it was recorded; beyond it the amplitude falls with the distance.
const NEAR_M: f64 = 1.5;

/// Share of the full pan of a source at one side: the far ear hears it too.
const WIDTH: f64 = 0.8;

/// Most samples of delay that [`Placing`] can apply: the largest time difference at 192 kHz.
const DELAY_MAX: usize = 128;

/// Seconds in which level and delay follow a change to 63 %.
const FOLLOWS_S: f32 = 0.01;

/// Gain and delay of a source at both ears, left then right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pan {
    pub(super) gain: [f32; 2],
    /// In seconds.
    pub(super) delay_s: [f32; 2],
}

impl Default for Pan {
    /// Sound that is played as it is.
    fn default() -> Pan {
        Pan { gain: [1.0; 2], delay_s: [0.0; 2] }
    }
}

/// The pan of a source at `source_m` metres from the listener: x to the right, y up, z backwards. A source straight
/// ahead within [`NEAR_M`] is played as it is.
pub(super) fn pan(source_m: DVec3) -> Pan {
    let distance = source_m.length();
    if !distance.is_finite() {
        return Pan { gain: [0.0; 2], ..Pan::default() };
    }
    // From -1 at the left to 1 at the right; 0 where the head is in the source.
    let sideways = if distance > 1e-6 { (source_m.x / distance).clamp(-1.0, 1.0) } else { 0.0 };
    // A source within the head comes from everywhere.
    let sideways = sideways * (distance / HEAD_RADIUS_M).min(1.0);
    let angle = (1.0 + WIDTH * sideways) * std::f64::consts::FRAC_PI_4;
    let level = std::f64::consts::SQRT_2 * (NEAR_M / distance.max(NEAR_M));
    let azimuth = sideways.abs().asin();
    let lateness = (HEAD_RADIUS_M / SPEED_M_S * (azimuth + azimuth.sin())) as f32;
    let delay_s = if sideways > 0.0 { [lateness, 0.0] } else { [0.0, lateness] };
    Pan { gain: [(level * angle.cos()) as f32, (level * angle.sin()) as f32], delay_s }
}

/// Applies a pan that changes to samples, without steps.
pub(super) struct Placing {
    /// Gain and delay in samples.
    gain: [f32; 2],
    delay: [f32; 2],
    follows: f32,
    rate_hz: f32,
    /// The latest samples.
    past: [Frame; DELAY_MAX],
    at: usize,
}

impl Placing {
    pub(super) fn new(rate_hz: u32) -> Placing {
        let rate_hz = rate_hz.max(1) as f32;
        Placing {
            gain: [1.0; 2],
            delay: [0.0; 2],
            follows: 1.0 / (FOLLOWS_S * rate_hz),
            rate_hz,
            past: [[0.0; 2]; DELAY_MAX],
            at: 0,
        }
    }

    /// The next sample, on the way to `target`.
    pub(super) fn place(&mut self, frame: Frame, target: &Pan) -> Frame {
        self.at = (self.at + 1) % DELAY_MAX;
        self.past[self.at] = frame;
        std::array::from_fn(|ear| {
            self.gain[ear] += (target.gain[ear] - self.gain[ear]) * self.follows;
            let delay = (target.delay_s[ear] * self.rate_hz).clamp(0.0, (DELAY_MAX - 2) as f32);
            self.delay[ear] += (delay - self.delay[ear]) * self.follows;
            let whole = self.delay[ear] as usize;
            let part = self.delay[ear] - whole as f32;
            let past = |ago: usize| self.past[(self.at + DELAY_MAX - ago) % DELAY_MAX][ear];
            self.gain[ear] * (past(whole) * (1.0 - part) + past(whole + 1) * part)
        })
    }
}

#[cfg(test)]
mod panner_tests {
    use super::*;
    use glam::dvec3;

    fn power(pan: &Pan) -> f32 {
        pan.gain.iter().map(|gain| gain * gain).sum()
    }

    #[test]
    fn straight_ahead_and_near_it_is_played_as_it_is() {
        for source in [dvec3(0.0, 0.0, -1.0), dvec3(0.0, 0.3, -1.2), dvec3(0.0, 0.0, 0.9), DVec3::ZERO] {
            let Pan { gain, delay_s } = pan(source);
            assert!(gain.iter().all(|gain| (gain - 1.0).abs() < 1e-6), "{source}: {gain:?}");
            assert_eq!(delay_s, [0.0; 2]);
        }
    }

    #[test]
    fn the_near_ear_hears_it_louder_and_earlier() {
        let [right, left] = [pan(dvec3(1.0, 0.0, 0.0)), pan(dvec3(-1.0, 0.0, 0.0))];
        assert!(right.gain[1] > 3.0 * right.gain[0] && right.gain[0] > 0.1, "{right:?}");
        // A quarter turn: r / c (pi / 2 + 1) = 656 us.
        assert!((right.delay_s[0] - 656e-6).abs() < 1e-6 && right.delay_s[1] == 0.0, "{right:?}");
        for ear in 0..2 {
            assert!((left.gain[ear] - right.gain[1 - ear]).abs() < 1e-6);
            assert!((left.delay_s[ear] - right.delay_s[1 - ear]).abs() < 1e-9);
        }
    }

    #[test]
    fn the_power_does_not_depend_on_the_direction_but_on_the_distance() {
        for step in 0..64 {
            let angle = f64::from(step) * std::f64::consts::TAU / 64.0;
            let direction = dvec3(angle.sin(), 0.0, -angle.cos());
            for (distance, expected) in [(0.5, 2.0), (1.5, 2.0), (3.0, 0.5), (15.0, 0.02)] {
                let power = power(&pan(direction * distance));
                assert!((power - expected).abs() < 1e-4 * expected, "{angle} {distance}: {power}");
            }
        }
        // No step where a listener walks through the source.
        let [before, after] = [pan(dvec3(-1e-3, 0.0, 0.0)), pan(dvec3(1e-3, 0.0, 0.0))];
        assert!((before.gain[0] - after.gain[0]).abs() < 0.02, "{before:?} {after:?}");
        assert_eq!(pan(dvec3(f64::NAN, 0.0, 0.0)).gain, [0.0; 2]);
    }

    #[test]
    fn a_pan_arrives_without_a_step() {
        let mut placing = Placing::new(48_000);
        let target = pan(dvec3(1.0, 0.0, 0.0));
        // A slow sine, so that a step would be seen.
        let wave = |i: usize| [0.5 * (i as f32 * 0.01).sin(); 2];
        let (mut last, mut largest) = ([0.0f32; 2], 0.0f32);
        for i in 0..48_000 {
            let frame = placing.place(wave(i), &target);
            largest = (0..2).map(|ear| (frame[ear] - last[ear]).abs()).fold(largest, f32::max);
            last = frame;
        }
        assert!(largest < 0.01, "{largest}");
        // 31.5 samples late at the far ear.
        let [left, right] = last;
        let late = 0.5 * ((47_999.0 - 656e-6 * 48_000.0) * 0.01f32).sin();
        assert!((left - target.gain[0] * late).abs() < 1e-3, "{left}");
        assert!((right - target.gain[1] * wave(47_999)[1]).abs() < 1e-3, "{right}");
    }
}
