//! [`MedianRange`] of what was measured several times, and the order in which to measure.

use serde::Serialize;

/// The middle of several numbers, and both ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct MedianRange {
    pub(crate) median: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

impl MedianRange {
    /// Of one number or more.
    pub(crate) fn of(values: impl IntoIterator<Item = f64>) -> MedianRange {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let (first, last) = (sorted[0], sorted[sorted.len() - 1]);
        let middle = sorted.len() / 2;
        let median = match sorted.len() % 2 {
            0 => 0.5 * (sorted[middle - 1] + sorted[middle]),
            _ => sorted[middle],
        };
        MedianRange { median, least: first, most: last }
    }

    /// Of the ratios of numbers that were measured in the same round.
    pub(crate) fn of_ratios(over: &[f64], under: &[f64]) -> MedianRange {
        MedianRange::of(over.iter().zip(under).map(|(over, under)| over / under))
    }
}

/// The order of `count` things in a round: there in one, back in the next, so that neither what comes
/// first nor what changes with time favours one of them.
pub(crate) fn in_turn(round: usize, count: usize) -> Vec<usize> {
    let there = 0..count;
    if round.is_multiple_of(2) { there.collect() } else { there.rev().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middles_and_ends() {
        assert_eq!(MedianRange::of([3.0, 1.0, 2.0]), MedianRange { median: 2.0, least: 1.0, most: 3.0 });
        assert_eq!(MedianRange::of([4.0, 1.0]).median, 2.5);
        assert_eq!(
            MedianRange::of_ratios(&[2.0, 6.0], &[1.0, 2.0]),
            MedianRange { median: 2.5, least: 2.0, most: 3.0 }
        );
    }

    #[test]
    fn rounds_go_there_and_back() {
        assert_eq!(in_turn(0, 3), [0, 1, 2]);
        assert_eq!(in_turn(1, 3), [2, 1, 0]);
    }
}
