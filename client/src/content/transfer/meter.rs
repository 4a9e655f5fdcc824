//! [`Meter`]: the download rate.

use std::collections::VecDeque;

/// Seconds over which the rate is averaged: long enough for a steady number, short enough to show a stall.
const WINDOW_S: f64 = 3.0;

/// Minimum seconds over which a rate is meaningful.
const MIN_S: f64 = 0.1;

/// Measures bytes per second over the last [`WINDOW_S`] seconds.
#[derive(Debug, Default)]
pub(super) struct Meter {
    /// Time in seconds, and bytes counted up to it.
    samples: VecDeque<(f64, u64)>,
    counted: u64,
}

impl Meter {
    /// Counts `bytes` received at `now_s`, seconds of a monotonic clock.
    pub(super) fn count(&mut self, now_s: f64, bytes: u64) {
        if self.samples.is_empty() {
            self.samples.push_back((now_s, 0));
        }
        self.counted += bytes;
        if self.samples.back().is_some_and(|(then_s, _)| now_s - then_s >= 0.5 * MIN_S) {
            self.samples.push_back((now_s, self.counted));
        }
        while self.samples.len() > 2 && self.samples[1].0 < now_s - WINDOW_S {
            self.samples.pop_front();
        }
    }

    /// The rate at `now_s`.
    pub(super) fn bytes_per_s(&self, now_s: f64) -> Option<f64> {
        let &(start_s, start) = self.samples.front()?;
        let elapsed_s = now_s - start_s;
        (elapsed_s >= MIN_S).then(|| (self.counted - start) as f64 / elapsed_s)
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

    #[test]
    fn a_fast_network_leaves_few_samples() {
        let mut meter = Meter::default();
        for millisecond in 0..10_000 {
            meter.count(f64::from(millisecond) * 1e-3, 10);
        }
        // Two in 0.1 s, and those around the start of the window.
        assert!(meter.samples.len() <= 62, "{}", meter.samples.len());
        let rate = meter.bytes_per_s(10.0).unwrap();
        assert!((rate - 10_000.0).abs() < 100.0, "{rate}");
    }
}
