//! [`LayerChoice`]: how many layers of the segments ahead a network brings in time.
//!
//! It follows the rate and the delay of the latest segments, as HTTP Live Streaming follows the rate: it goes down at
//! once, and up by one layer after three segments that would have left a third of the time with it.

use std::collections::VecDeque;
use std::time::Duration;

use crate::content::{Needs, Traffic};

/// Number of latest segments that count.
const RECENT: usize = 3;

/// Part of the time that a further layer may take to be tried.
const SHARE_MAX: f64 = 2.0 / 3.0;

/// Number of segments in a row that were fast enough before a further layer is loaded.
const FAST_MIN: u32 = 3;

/// The number of layers to load.
#[derive(Debug)]
pub(super) struct LayerChoice {
    layers: usize,
    /// Most layers of a segment.
    most: usize,
    recent: VecDeque<Traffic>,
    fast: u32,
}

impl LayerChoice {
    /// All of at most `most` layers, until segments have come slowly.
    pub(super) fn new(most: usize) -> LayerChoice {
        LayerChoice { layers: most, most, recent: VecDeque::new(), fast: 0 }
    }

    /// Number of layers to load of each segment, at least 1.
    pub(super) fn layers(&self) -> usize {
        self.layers
    }

    /// Takes in a segment. `needs` is what playing needs of a number of layers. A segment that took nothing from the
    /// server, because it is in the cache, was fast.
    pub(super) fn on_segment(&mut self, traffic: Traffic, needs: impl Fn(usize) -> Needs) {
        if traffic.bytes > 0 {
            self.recent.push_back(traffic);
            if self.recent.len() > RECENT {
                self.recent.pop_front();
            }
        }
        let share = |layers| if traffic.bytes > 0 { self.share(needs(layers)) } else { 0.0 };
        if share(self.layers) > 1.0 {
            self.layers = (1..self.layers).rev().find(|layers| share(*layers) <= 1.0).unwrap_or(1);
            self.fast = 0;
        } else if self.layers < self.most && share(self.layers + 1) <= SHARE_MAX {
            self.fast += 1;
            if self.fast == FAST_MIN {
                (self.layers, self.fast) = (self.layers + 1, 0);
            }
        } else {
            self.fast = 0;
        }
    }

    /// Part of the time that loading takes which needs so much.
    fn share(&self, needs: Needs) -> f64 {
        let sum = |duration: fn(&Traffic) -> Duration| {
            self.recent.iter().map(duration).sum::<Duration>().as_secs_f64()
        };
        let bytes: u64 = self.recent.iter().map(|traffic| traffic.bytes).sum();
        let seconds_per_byte = sum(|traffic| traffic.elapsed) / bytes as f64;
        let delay = sum(|traffic| traffic.delay) / self.recent.len() as f64;
        needs.bytes * seconds_per_byte + needs.segments * delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Layers need 1, 2, 3 and 4 kB a second, of one segment.
    fn needs(layers: usize) -> Needs {
        Needs { bytes: 1000.0 * layers as f64, segments: 1.0 }
    }

    fn traffic(bytes: u64, delay_ms: u64) -> Traffic {
        Traffic { bytes, delay: Duration::from_millis(delay_ms), elapsed: Duration::from_secs(1) }
    }

    /// The choice after each of `rates`, in bytes a second.
    fn choices(choice: &mut LayerChoice, rates: &[u64], delay_ms: u64) -> Vec<usize> {
        let mut after = |bytes: &u64| {
            choice.on_segment(traffic(*bytes, delay_ms), needs);
            choice.layers()
        };
        rates.iter().map(&mut after).collect()
    }

    #[test]
    fn it_goes_down_at_once_and_up_slowly() {
        let mut choice = LayerChoice::new(4);
        assert_eq!(choices(&mut choice, &[9000, 9000, 9000], 0), [4, 4, 4], "there are no more");
        // The mean of the latest three decides.
        assert_eq!(choices(&mut choice, &[100, 100, 100], 0), [4, 3, 1]);
        assert_eq!(choices(&mut choice, &[3001; 6], 0), [1, 1, 1, 1, 2, 2], "1.5 times as fast, three times");
        assert_eq!(choices(&mut choice, &[4400; 6], 0), [2; 6], "below 1.5 times what three layers need");
        assert_eq!(choices(&mut choice, &[100_000; 6], 0), [2, 2, 3, 3, 3, 4]);
    }

    #[test]
    fn one_slow_segment_between_fast_ones_begins_the_count_again() {
        let mut choice = LayerChoice::new(2);
        assert_eq!(choices(&mut choice, &[100, 100, 100], 0), [1, 1, 1]);
        // The means are 3033, 3000, 2967, 3034, 3067 and 3101.
        assert_eq!(choices(&mut choice, &[8901, 1, 1, 9100, 100, 101], 0), [1, 1, 1, 1, 1, 2]);
    }

    #[test]
    fn the_delay_of_requests_counts_once_a_segment_however_small_they_are() {
        let mut choice = LayerChoice::new(2);
        choices(&mut choice, &[100, 100, 100], 0);
        // A kilobyte a millisecond after half a second: two layers take 0.502 s of each second.
        let quick = Traffic { elapsed: Duration::from_millis(1), ..traffic(1000, 500) };
        for layers in [1, 1, 1, 1, 2] {
            choice.on_segment(quick, needs);
            assert_eq!(choice.layers(), layers);
        }
        // With a delay of a second there is no time for anything.
        assert_eq!(choices(&mut choice, &[100_000; 4], 1000), [2, 2, 1, 1]);
    }

    #[test]
    fn what_is_in_the_cache_is_fast() {
        let mut choice = LayerChoice::new(2);
        assert_eq!(choices(&mut choice, &[100, 100], 0), [1, 1]);
        for layers in [1, 1, 2, 2] {
            choice.on_segment(Traffic::default(), needs);
            assert_eq!(choice.layers(), layers);
        }
    }

    #[test]
    fn extreme_rates_are_rates_too() {
        let mut choice = LayerChoice::new(3);
        choice.on_segment(Traffic { elapsed: Duration::ZERO, ..traffic(u64::MAX / 4, 0) }, needs);
        assert_eq!(choice.layers(), 3);
        choice.on_segment(Traffic { elapsed: Duration::MAX / 4, ..traffic(1, 0) }, |_| Needs {
            bytes: f64::INFINITY,
            segments: 1.0,
        });
        assert_eq!(choice.layers(), 1);
    }
}
