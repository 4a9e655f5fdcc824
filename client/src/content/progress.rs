//! [`Progress`]: how much of a download has arrived, at which rate, and how long the rest takes. [`Traffic`]: what came
//! from a server, and in which time.

use std::ops::Sub;
use std::time::Duration;

/// State of a download.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Bytes received.
    pub received: u64,
    /// Size in bytes, if the server announces it.
    pub total: Option<u64>,
    /// Bytes per second, once measured.
    pub bytes_per_s: Option<f64>,
    /// Why the download stalls, and the remedy under way.
    pub trouble: Option<String>,
}

impl Progress {
    /// Received fraction, 0 to 1, if the size is known.
    pub fn part(&self) -> Option<f32> {
        let total = self.total.filter(|&total| total > 0)?;
        Some((self.received as f64 / total as f64).min(1.0) as f32)
    }

    /// Seconds until completion at the present rate.
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
        let rate = self.bytes_per_s.map(|rate| format!(", {}", speed(rate)));
        let left = self.remaining_s().map(|seconds| format!(", {} left", duration(seconds)));
        format!("{amount}{}{}", rate.unwrap_or_default(), left.unwrap_or_default())
    }
}

/// What came from a server.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Traffic {
    pub(crate) bytes: u64,
    /// Time until answers began.
    pub(crate) delay: Duration,
    /// Time from there to their ends.
    pub(crate) elapsed: Duration,
}

impl Sub for Traffic {
    type Output = Traffic;

    fn sub(self, earlier: Traffic) -> Traffic {
        Traffic {
            bytes: self.bytes - earlier.bytes,
            delay: self.delay - earlier.delay,
            elapsed: self.elapsed - earlier.elapsed,
        }
    }
}

fn megabytes(bytes: u64) -> String {
    let megabytes = bytes as f64 * 1e-6;
    if megabytes < 99.95 { format!("{megabytes:.1}") } else { format!("{megabytes:.0}") }
}

fn speed(bytes_per_s: f64) -> String {
    if bytes_per_s < 1e6 {
        format!("{:.0} kB/s", bytes_per_s * 1e-3)
    } else {
        format!("{} MB/s", megabytes(bytes_per_s as u64))
    }
}

fn duration(seconds: f64) -> String {
    let seconds = seconds.ceil().min(359_999.0) as u64;
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
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
        assert_eq!(progress.text(), "0.4 of 2.0 MB, 800 kB/s, 2 s left");
        assert_eq!((progress.part(), progress.remaining_s()), (Some(0.2), Some(2.0)));
        progress.bytes_per_s = Some(0.0);
        assert_eq!(progress.text(), "0.4 of 2.0 MB, 0 kB/s", "no estimate at this rate");
        progress.bytes_per_s = Some(7.25e6);
        assert_eq!(progress.text(), "0.4 of 2.0 MB, 7.2 MB/s, 1 s left");
        progress.trouble = Some("the connection was lost".into());
        assert_eq!(progress.text(), "0.4 of 2.0 MB: the connection was lost");
        let wrong = Progress { received: 9, total: Some(3), ..Progress::default() };
        assert_eq!(wrong.part(), Some(1.0), "more than announced");
    }

    #[test]
    fn short_durations_are_shown_finely() {
        assert_eq!([0.2, 59.0, 61.5, 7300.0].map(duration), ["1 s", "59 s", "1 min 2 s", "2 h 1 min"]);
        assert_eq!(duration(f64::INFINITY), "99 h 59 min");
    }
}
