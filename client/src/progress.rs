//! [`Progress`]: how much of a clip has arrived, how fast, and when the rest will be there.

use std::collections::VecDeque;

/// Seconds over which the rate is taken: long enough to read, short enough to tell a stall.
const WINDOW_S: f64 = 3.0;

/// Least seconds after which a rate means anything.
const LEAST_S: f64 = 0.1;

/// What is known of a clip on its way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Bytes that are here.
    pub received: u64,
    /// Bytes in all, if that is known.
    pub total: Option<u64>,
    /// Bytes per second, once there is something to tell.
    pub bytes_per_s: Option<f64>,
    /// What holds it up, and what is done about it.
    pub trouble: Option<String>,
}

impl Progress {
    /// The part that is here, 0 to 1, if the whole is known.
    pub fn part(&self) -> Option<f32> {
        let total = self.total.filter(|&total| total > 0)?;
        Some((self.received as f64 / total as f64).min(1.0) as f32)
    }

    /// Seconds until the rest is here at the present rate.
    pub fn remaining_s(&self) -> Option<f64> {
        let rate = self.bytes_per_s.filter(|&rate| rate > 0.0)?;
        Some(self.total?.saturating_sub(self.received) as f64 / rate)
    }

    /// One line: bytes, rate and time left, or bytes and trouble.
    pub fn text(&self) -> String {
        let received = megabytes(self.received);
        let amount = match self.total {
            Some(total) => format!("{received} of {} MB", megabytes(total)),
            None => format!("{received} MB"),
        };
        if let Some(trouble) = &self.trouble {
            return format!("{amount}: {trouble}");
        }
        let rate = self.bytes_per_s.map(|rate| format!(", {} MB/s", megabytes(rate as u64)));
        let left = self.remaining_s().map(|seconds| format!(", {} left", duration(seconds)));
        format!("{amount}{}{}", rate.unwrap_or_default(), left.unwrap_or_default())
    }
}

fn megabytes(bytes: u64) -> String {
    let megabytes = bytes as f64 * 1e-6;
    if megabytes < 99.95 { format!("{megabytes:.1}") } else { format!("{megabytes:.0}") }
}

fn duration(seconds: f64) -> String {
    let seconds = seconds.ceil().min(359_999.0) as u64;
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

/// Bytes per second over the last few seconds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Meter {
    /// When, in seconds, and how many bytes had been counted by then.
    samples: VecDeque<(f64, u64)>,
    counted: u64,
}

impl Meter {
    /// Counts `bytes` that arrived at `now_s`, seconds of any clock.
    pub(crate) fn count(&mut self, now_s: f64, bytes: u64) {
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
    pub(crate) fn bytes_per_s(&self, now_s: f64) -> Option<f64> {
        let &(start_s, start) = self.samples.front()?;
        let elapsed_s = now_s - start_s;
        (elapsed_s >= LEAST_S).then(|| (self.counted - start) as f64 / elapsed_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_much_how_fast_and_how_long() {
        let mut progress = Progress { received: 400_000, ..Progress::default() };
        assert_eq!((progress.text().as_str(), progress.part()), ("0.4 MB", None));
        progress.total = Some(2_000_000);
        progress.bytes_per_s = Some(800_000.0);
        assert_eq!(progress.text(), "0.4 of 2.0 MB, 0.8 MB/s, 2 s left");
        assert_eq!((progress.part(), progress.remaining_s()), (Some(0.2), Some(2.0)));
        progress.bytes_per_s = Some(0.0);
        assert_eq!(progress.text(), "0.4 of 2.0 MB, 0.0 MB/s", "nobody knows how long");
        progress.trouble = Some("the connection was lost".into());
        assert_eq!(progress.text(), "0.4 of 2.0 MB: the connection was lost");
        let wrong = Progress { received: 9, total: Some(3), ..Progress::default() };
        assert_eq!(wrong.part(), Some(1.0), "more than announced");
    }

    #[test]
    fn durations_are_as_fine_as_they_are_short() {
        assert_eq!([0.2, 59.0, 61.5, 7300.0].map(duration), ["1 s", "59 s", "1 min 2 s", "2 h 1 min"]);
        assert_eq!(duration(f64::INFINITY), "99 h 59 min");
    }

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
