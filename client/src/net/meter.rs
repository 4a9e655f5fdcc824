//! [`Meter`]: how fast bytes arrive.

use std::collections::VecDeque;

/// Seconds over which the rate is taken: long enough to read, short enough to tell a stall.
const WINDOW_S: f64 = 3.0;

/// Least seconds after which a rate means anything.
const LEAST_S: f64 = 0.1;

/// Bytes per second over the last few seconds.
#[derive(Debug, Default)]
pub(super) struct Meter {
    /// When, in seconds, and how many bytes had been counted by then.
    samples: VecDeque<(f64, u64)>,
    counted: u64,
}

impl Meter {
    /// Counts `bytes` that arrived at `now_s`, seconds of any clock.
    pub(super) fn count(&mut self, now_s: f64, bytes: u64) {
        if self.samples.is_empty() {
            self.samples.push_back((now_s, 0));
        }
        self.counted += bytes;
        // Samples closer than this tell nothing more.
        if self.samples.back().is_some_and(|(then_s, _)| now_s - then_s >= 0.5 * LEAST_S) {
            self.samples.push_back((now_s, self.counted));
        }
        while self.samples.len() > 2 && self.samples[1].0 < now_s - WINDOW_S {
            self.samples.pop_front();
        }
    }

    /// The rate as of `now_s`.
    pub(super) fn bytes_per_s(&self, now_s: f64) -> Option<f64> {
        let &(start_s, start) = self.samples.front()?;
        let elapsed_s = now_s - start_s;
        (elapsed_s >= LEAST_S).then(|| (self.counted - start) as f64 / elapsed_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_seconds() {
        let mut meter = Meter::default();
        assert_eq!(meter.bytes_per_s(0.0), None);
        for tenth in 0..=50 {
            meter.count(f64::from(tenth) * 0.1, 100);
        }
        let rate = meter.bytes_per_s(5.0).unwrap();
        assert!((rate - 1000.0).abs() < 50.0, "{rate}");
        let stalled = meter.bytes_per_s(30.0).unwrap();
        assert!(stalled < 150.0, "{stalled} after a stall");
        meter.count(40.0, 1);
        meter.count(41.0, 5000);
        let again = meter.bytes_per_s(41.0).unwrap();
        assert!((100.0..6000.0).contains(&again) && meter.samples.len() < 9, "{again}, {:?}", meter.samples);
    }
}
