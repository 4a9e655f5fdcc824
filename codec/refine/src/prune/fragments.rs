//! [`within_fragments`]: how many rows of an order a budget of fragments holds.
//!
//! A player pays for fragments, not for Gaussians: a few large, faint Gaussians can cost half of a frame. In the
//! order of blending weight per fragment, each fragment that is left out costs the pictures least.

use crate::reference::Contribution;

/// The scores of rows by blending weight per fragment, which is the mean of `alpha T` over the pixels of a
/// Gaussian's quad, 0 to 1. A row without fragments costs nothing, and its score is infinite.
pub fn weight_per_fragment(seen: &[Contribution]) -> Vec<f64> {
    let score = |row: &Contribution| match row.fragments > 0.0 {
        true => row.weight / row.fragments,
        false => f64::INFINITY,
    };
    seen.iter().map(score).collect()
}

/// The largest number of leading rows of `order` that have together at most `fraction` of its fragments.
/// `seen` are the contributions of the rows of the field.
///
/// # Panics
/// If `order` names a row that `seen` lacks.
pub fn within_fragments(order: &[usize], seen: &[Contribution], fraction: f64) -> usize {
    let total: f64 = order.iter().map(|&row| seen[row].fragments).sum();
    let mut sum = 0.0;
    let fits = |row: &&usize| {
        sum += seen[**row].fragments;
        sum <= fraction * total
    };
    order.iter().take_while(fits).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::by_importance;

    fn row(weight: f64, fragments: f64) -> Contribution {
        Contribution { weight, fragments, ..Contribution::default() }
    }

    #[test]
    fn large_faint_rows_go_first_and_unseen_ones_last() {
        let seen = [row(5.0, 100.0), row(4.0, 10.0), row(0.0, 0.0), row(0.0, 40.0), row(9.0, 50.0)];
        let order = by_importance(&weight_per_fragment(&seen));
        assert_eq!(order, [2, 1, 4, 0, 3]);
        // Of 200 fragments in all.
        for (fraction, count) in [(0.0, 1), (0.049, 1), (0.05, 2), (0.3, 3), (0.79, 3), (0.8, 4), (1.0, 5)] {
            assert_eq!(within_fragments(&order, &seen, fraction), count, "{fraction}");
        }
        assert_eq!(within_fragments(&[], &seen, 0.5), 0);
    }
}
