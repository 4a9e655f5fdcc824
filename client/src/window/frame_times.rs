//! [`FrameTimes`]: the intervals between frames while the clip plays.

use crate::stats::Summary;

/// Number of intervals in the summary: two seconds at 60 frames per second.
const FRAMES: usize = 120;

/// The latest intervals between frames.
#[derive(Debug, Default)]
pub(crate) struct FrameTimes {
    intervals_ms: Vec<f64>,
    /// Index of the oldest interval once there are [`FRAMES`].
    next: usize,
}

impl FrameTimes {
    /// Adds the interval between two successive frames.
    pub(crate) fn push(&mut self, interval_s: f64) {
        let interval_ms = interval_s * 1e3;
        if self.intervals_ms.len() < FRAMES {
            self.intervals_ms.push(interval_ms);
        } else {
            self.intervals_ms[self.next] = interval_ms;
            self.next = (self.next + 1) % FRAMES;
        }
    }

    /// Summary of the intervals in milliseconds; `None` before the first.
    pub(crate) fn summary(&self) -> Option<Summary> {
        (!self.intervals_ms.is_empty()).then(|| Summary::new(self.intervals_ms.iter().copied()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_latest_frames_count() {
        let mut times = FrameTimes::default();
        assert_eq!(times.summary(), None);
        for _ in 0..FRAMES + 7 {
            times.push(1.0);
        }
        for _ in 0..FRAMES - 1 {
            times.push(0.010);
        }
        assert_eq!(times.intervals_ms.len(), FRAMES);
        let summary = times.summary().unwrap();
        assert!((summary.median - 10.0).abs() < 1e-9 && (summary.p95 - 10.0).abs() < 1e-9);
        assert_eq!(times.intervals_ms.iter().filter(|&&ms| ms == 1000.0).count(), 1);
    }
}
