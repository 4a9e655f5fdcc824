//! [`LayerChoice`]: how many layers of the segments ahead a network brings in time.
//!
//! It follows the rate at which segments arrive, as HTTP Live Streaming does: it goes down at once, and up by one layer
//! after three segments that came 1.5 times as fast as that layer needs. It changes between segments only.

use std::collections::VecDeque;
use std::time::Duration;

/// Number of latest segments whose rate counts.
const RECENT: usize = 3;

/// Rate over the one needed from which a further layer is tried.
const MARGIN: f64 = 1.5;

/// Number of segments in a row that were fast enough before a further layer is loaded.
const FAST_MIN: u32 = 3;

/// Bytes from a network, and how long they took, with the delay of the request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fetched {
    pub(super) bytes: u64,
    pub(super) elapsed: Duration,
}

/// The number of layers to load.
#[derive(Debug)]
pub(super) struct LayerChoice {
    layers: usize,
    /// Most layers of a segment.
    most: usize,
    recent: VecDeque<Fetched>,
    fast: u32,
}

impl LayerChoice {
    /// All of at most `most` layers, until a segment has come slowly.
    pub(super) fn new(most: usize) -> LayerChoice {
        LayerChoice { layers: most, most, recent: VecDeque::new(), fast: 0 }
    }

    /// Number of layers to load of each segment, at least 1.
    pub(super) fn layers(&self) -> usize {
        self.layers
    }

    /// Takes in a segment. `needed` is the number of bytes a second that playing needs of a number of layers.
    pub(super) fn on_segment(&mut self, fetched: Fetched, needed: impl Fn(usize) -> f64) {
        self.recent.push_back(fetched);
        if self.recent.len() > RECENT {
            self.recent.pop_front();
        }
        let bytes: u64 = self.recent.iter().map(|fetched| fetched.bytes).sum();
        let elapsed: Duration = self.recent.iter().map(|fetched| fetched.elapsed).sum();
        let rate = bytes as f64 / elapsed.as_secs_f64().max(f64::MIN_POSITIVE);
        if rate < needed(self.layers) {
            self.layers = (1..self.layers).rev().find(|layers| needed(*layers) <= rate).unwrap_or(1);
            self.fast = 0;
        } else if self.layers < self.most && rate >= MARGIN * needed(self.layers + 1) {
            self.fast += 1;
            if self.fast == FAST_MIN {
                (self.layers, self.fast) = (self.layers + 1, 0);
            }
        } else {
            self.fast = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Layers need 1, 2, 3 and 4 kB a second.
    fn needed(layers: usize) -> f64 {
        1000.0 * layers as f64
    }

    /// The choice after each of `rates`, in bytes a second.
    fn choices(choice: &mut LayerChoice, rates: &[u64]) -> Vec<usize> {
        let mut after = |bytes: &u64| {
            choice.on_segment(Fetched { bytes: *bytes, elapsed: Duration::from_secs(1) }, needed);
            choice.layers()
        };
        rates.iter().map(&mut after).collect()
    }

    #[test]
    fn it_goes_down_at_once_and_up_slowly() {
        let mut choice = LayerChoice::new(4);
        assert_eq!(choices(&mut choice, &[9000, 9000, 9000]), [4, 4, 4], "there are no more");
        // The mean of the latest three decides.
        assert_eq!(choices(&mut choice, &[100, 100, 100]), [4, 3, 1]);
        assert_eq!(choices(&mut choice, &[3000; 6]), [1, 1, 1, 1, 2, 2], "1.5 times as fast, three times");
        assert_eq!(choices(&mut choice, &[4400; 6]), [2; 6], "below 1.5 times what three layers need");
        assert_eq!(choices(&mut choice, &[100_000; 6]), [2, 2, 3, 3, 3, 4]);
    }

    #[test]
    fn one_slow_segment_between_fast_ones_begins_the_count_again() {
        let mut choice = LayerChoice::new(2);
        assert_eq!(choices(&mut choice, &[100, 100, 100]), [1, 1, 1]);
        // The means are 3033, 3000, 2967, 3033, 3067 and 3100.
        assert_eq!(choices(&mut choice, &[8900, 0, 0, 9100, 100, 100]), [1, 1, 1, 1, 1, 2]);
    }

    #[test]
    fn what_takes_no_time_or_brings_nothing_is_a_rate_too() {
        let mut choice = LayerChoice::new(3);
        choice.on_segment(Fetched { bytes: 0, elapsed: Duration::ZERO }, needed);
        assert_eq!(choice.layers(), 1);
        choice.on_segment(Fetched { bytes: u64::MAX / 4, elapsed: Duration::ZERO }, needed);
        assert_eq!(choice.layers(), 1);
        let mut none = LayerChoice::new(1);
        none.on_segment(Fetched { bytes: 1, elapsed: Duration::MAX / 4 }, |_| f64::INFINITY);
        assert_eq!(none.layers(), 1);
    }
}
