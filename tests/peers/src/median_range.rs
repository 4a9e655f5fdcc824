//! [`MedianRange`] of repeated measurements, and their order.

use serde::Serialize;

/// Median, minimum and maximum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct MedianRange {
    pub(crate) median: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

impl MedianRange {
    /// The median and range of at least one number.
    pub(crate) fn new(values: impl IntoIterator<Item = f64>) -> MedianRange {
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

    /// The median and range of the ratios `over[i] / under[i]`, each within one round.
    pub(crate) fn of_ratios(over: &[f64], under: &[f64]) -> MedianRange {
        MedianRange::new(over.iter().zip(under).map(|(over, under)| over / under))
    }
}

/// The order of `count` candidates in a round. Every second round is reversed, so that neither the position
/// nor drift over time favours a candidate.
pub(crate) fn in_turn(round: usize, count: usize) -> Vec<usize> {
    let order = 0..count;
    if round.is_multiple_of(2) { order.collect() } else { order.rev().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_ranges() {
        assert_eq!(MedianRange::new([3.0, 1.0, 2.0]), MedianRange { median: 2.0, least: 1.0, most: 3.0 });
        assert_eq!(MedianRange::new([4.0, 1.0]).median, 2.5);
        assert_eq!(
            MedianRange::of_ratios(&[2.0, 6.0], &[1.0, 2.0]),
            MedianRange { median: 2.5, least: 2.0, most: 3.0 }
        );
    }

    #[test]
    fn every_second_round_is_reversed() {
        assert_eq!(in_turn(0, 3), [0, 1, 2]);
        assert_eq!(in_turn(1, 3), [2, 1, 0]);
    }
}
