//! [`Timing`]: the presentation times of a video's frames, at a constant or at a variable rate.
//!
//! A variable rate is like a phone's: each frame is early or late by up to a fifth of an interval, and sometimes one is
//! missing. The pattern repeats every 32 intervals, because a filter of ffmpeg sets the times, by a formula: pictures
//! from a pipe have none.

use super::draws::{Draw, draw};

/// Ticks in a second of the times of a video with a variable rate, as is customary.
pub(super) const TICKS_PER_SECOND: u32 = 90_000;

/// Intervals in a pattern of a variable rate, and those whose frame is missing: one in each part of so many intervals.
const PATTERN: usize = 32;
const DROP_PART: usize = 16;

/// Largest deviation of a frame's time, in intervals.
const JITTER: f64 = 0.2;

/// Presentation times since the first frame.
#[derive(Clone, Debug)]
pub(super) enum Timing {
    /// This many frames in 1000 seconds.
    Constant { millifps: u32 },
    /// Ticks of the frames of a pattern, the first at 0, and ticks until the pattern repeats.
    Variable { ticks: Vec<u64>, period: u64 },
}

impl Timing {
    /// A variable rate for a camera.
    pub(super) fn variable(millifps: u32, seed: u64, camera: usize) -> Timing {
        let interval = f64::from(TICKS_PER_SECOND) * 1000.0 / f64::from(millifps);
        let number = |part: usize| {
            // Never the first of a part, with which the pattern begins.
            let drawn = draw(seed, camera, Draw::Drop(part)) * 0.5 + 0.5;
            part * DROP_PART + 1 + ((drawn * (DROP_PART - 1) as f64) as usize).min(DROP_PART - 2)
        };
        let dropped: Vec<usize> = (0..PATTERN / DROP_PART).map(number).collect();
        let tick = |slot: usize| {
            let jitter = if slot == 0 { 0.0 } else { JITTER * draw(seed, camera, Draw::Jitter(slot)) };
            ((slot as f64 + jitter) * interval).round() as u64
        };
        Timing::Variable {
            ticks: (0..PATTERN).filter(|slot| !dropped.contains(slot)).map(tick).collect(),
            period: (PATTERN as f64 * interval).round() as u64,
        }
    }

    /// Presentation time of a frame in seconds, by the camera.
    pub(super) fn seconds(&self, frame: usize) -> f64 {
        match self {
            Timing::Constant { millifps } => frame as f64 * 1000.0 / f64::from(*millifps),
            Timing::Variable { ticks, period } => {
                let tick = (frame / ticks.len()) as u64 * period + ticks[frame % ticks.len()];
                tick as f64 / f64::from(TICKS_PER_SECOND)
            }
        }
    }

    /// The filter of ffmpeg that gives frames their times; `None` if their number does.
    pub(super) fn filter(&self) -> Option<String> {
        let Timing::Variable { ticks, period } = self else { return None };
        let frames = ticks.len();
        let of_frame = |(frame, tick): (usize, &u64)| format!("+eq(mod(N\\,{frames})\\,{frame})*{tick}");
        let in_pattern: String = ticks.iter().enumerate().skip(1).map(of_frame).collect();
        Some(format!("settb=1/{TICKS_PER_SECOND},setpts=floor(N/{frames})*{period}{in_pattern}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_rate_has_equal_intervals() {
        let timing = Timing::Constant { millifps: 25_000 };
        assert_eq!([0, 1, 50].map(|frame| timing.seconds(frame)), [0.0, 0.04, 2.0]);
        assert!(timing.filter().is_none());
    }

    #[test]
    fn a_variable_rate_has_jitter_and_gaps_and_keeps_its_mean() {
        for (millifps, seed) in [(30_000, 1), (29_970, 2), (240_000, 3), (1000, 4)] {
            let timing = Timing::variable(millifps, seed, 2);
            let interval = 1000.0 / f64::from(millifps);
            let steps: Vec<f64> = (0..300)
                .map(|frame| (timing.seconds(frame + 1) - timing.seconds(frame)) / interval)
                .collect();
            assert!(steps.iter().all(|step| (0.55..2.45).contains(step)), "{steps:?}");
            let gaps = steps.iter().filter(|step| **step > 1.5).count();
            assert_eq!(gaps, 20, "two in each pattern of 30 frames");
            assert!(steps.iter().any(|step| (step - 1.0).abs() > 0.1 && *step < 1.5));
            // 30 of 32 frames are there.
            assert!((timing.seconds(300) / interval - 320.0).abs() < 0.1);
        }
    }

    #[test]
    fn the_filter_counts_what_the_times_count() {
        let timing = Timing::Variable { ticks: vec![0, 2900, 6100], period: 9000 };
        assert_eq!(
            timing.filter().unwrap(),
            "settb=1/90000,setpts=floor(N/3)*9000+eq(mod(N\\,3)\\,1)*2900+eq(mod(N\\,3)\\,2)*6100"
        );
        assert_eq!(timing.seconds(5), 15_100.0 / 90_000.0);
    }
}
