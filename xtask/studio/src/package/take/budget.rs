//! [`budgets`]: how many Gaussians each segment may keep so that no instant has more than a budget.
//!
//! All segments keep the same fraction of their Gaussians, which rises until some instant is full; the segments that
//! hold it stay there, and the others go on. So no segment could keep more without another keeping less.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use crate::segments::{Span, held_at_starts};

/// The segments that hold an instant, and the number left to its segments without a budget.
struct Instant {
    segments: Vec<usize>,
    left: u128,
    /// Gaussians of the segments without a budget.
    weight: u128,
}

/// An instant at which a fraction is left to segments without a budget. Compares by the fraction, then by the number.
struct Full {
    left: u128,
    weight: u128,
    instant: usize,
}

impl Ord for Full {
    fn cmp(&self, other: &Full) -> Ordering {
        let fractions = (self.left * other.weight).cmp(&(other.left * self.weight));
        fractions.then(self.instant.cmp(&other.instant))
    }
}

impl PartialOrd for Full {
    fn partial_cmp(&self, other: &Full) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Full {
    fn eq(&self, other: &Full) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Full {}

/// The number of Gaussians that each segment keeps of its `gaussians`, so that those which hold one instant keep at
/// most `budget` together. 0 where nothing is left.
pub(super) fn budgets(budget: usize, spans: &[Span], gaussians: &[usize]) -> Vec<usize> {
    let mut instants = instants(budget, spans, gaussians);
    let mut instants_of: Vec<Vec<usize>> = vec![Vec::new(); spans.len()];
    for (i, instant) in instants.iter().enumerate() {
        instant.segments.iter().for_each(|&segment| instants_of[segment].push(i));
    }
    let entry = |i: usize, instant: &Instant| {
        let Instant { left, weight, .. } = *instant;
        (weight > 0).then_some(Reverse(Full { left, weight, instant: i }))
    };
    let mut queue: BinaryHeap<Reverse<Full>> =
        instants.iter().enumerate().filter_map(|(i, instant)| entry(i, instant)).collect();
    let mut kept: Vec<Option<usize>> = vec![None; spans.len()];
    while let Some(Reverse(full)) = queue.pop() {
        let instant = &instants[full.instant];
        if (instant.left, instant.weight) != (full.left, full.weight) {
            // It has another entry by now.
            continue;
        }
        if full.left >= full.weight {
            break;
        }
        let waiting: Vec<usize> =
            instant.segments.iter().copied().filter(|&segment| kept[segment].is_none()).collect();
        let mut changed = Vec::new();
        for segment in waiting {
            let weight = gaussians[segment] as u128;
            let share = weight * full.left / full.weight;
            kept[segment] = Some(share as usize);
            for &i in &instants_of[segment] {
                instants[i].left -= share;
                instants[i].weight -= weight;
                changed.push(i);
            }
        }
        changed.sort_unstable();
        changed.dedup();
        queue.extend(changed.into_iter().filter_map(|i| entry(i, &instants[i])));
    }
    kept.into_iter().zip(gaussians).map(|(kept, &all)| kept.unwrap_or(all)).collect()
}

/// The starts of segments: at one of them the most segments hold an instant.
fn instants(budget: usize, spans: &[Span], gaussians: &[usize]) -> Vec<Instant> {
    let instant = |(_, segments): (f64, Vec<usize>)| {
        let weight = segments.iter().map(|&segment| gaussians[segment] as u128).sum();
        Instant { segments, left: budget as u128, weight }
    };
    held_at_starts(spans).map(instant).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(budget: usize, segments: &[(f64, f64, usize)]) -> Vec<usize> {
        let spans: Vec<Span> =
            segments.iter().map(|&(start_s, duration_s, _)| Span { start_s, duration_s, level: 0 }).collect();
        let gaussians: Vec<usize> = segments.iter().map(|segment| segment.2).collect();
        let kept = budgets(budget, &spans, &gaussians);
        for span in &spans {
            let at = |t: f64| -> usize {
                let held =
                    spans.iter().zip(&kept).filter(|(other, _)| other.start_s <= t && t < other.end_s());
                held.map(|(_, kept)| kept).sum()
            };
            assert!(at(span.start_s.max(0.0)) <= budget, "{kept:?}");
        }
        kept
    }

    #[test]
    fn segments_one_after_another_have_the_whole_budget_each() {
        let take = [(0.0, 1.0, 500), (1.0, 1.0, 80), (2.0, 1.0, 100)];
        assert_eq!(shares(100, &take), [100, 80, 100]);
    }

    #[test]
    fn segments_together_keep_the_same_fraction() {
        assert_eq!(shares(100, &[(0.0, 2.0, 300), (1.0, 2.0, 100)]), [75, 25]);
        assert_eq!(shares(7, &[(-1.0, 2.0, 10), (0.0, 2.0, 10), (0.0, 1.0, 1)]), [3, 3, 0]);
    }

    #[test]
    fn what_a_full_instant_cannot_use_goes_to_others() {
        // The busy second bounds the long segment; the quiet one is bounded by that only.
        let take = [(0.0, 4.0, 100), (0.0, 1.0, 900), (2.0, 1.0, 500), (3.0, 1.0, 20)];
        assert_eq!(shares(100, &take), [10, 90, 90, 20]);
    }

    #[test]
    fn a_long_take_of_levels_is_quick_and_full() {
        let mut take = Vec::new();
        for level in 0..10 {
            let step = f64::from(1 << level);
            let count = 4096 >> level;
            take.extend(
                (0..count).map(|k| (f64::from(k) * step, 2.0 * step, 1000 + (k as usize * 7919) % 500)),
            );
        }
        let kept = shares_of_long(&take);
        assert!(kept.iter().all(|&kept| kept > 0));
        // At every start the budget is nearly used, except where all is kept.
        let used = |t: f64| -> usize {
            let held = take
                .iter()
                .zip(&kept)
                .filter(|((start, duration, _), _)| *start <= t && t < start + duration);
            held.map(|(_, kept)| kept).sum()
        };
        let fullest = (0..4096).map(|t| used(f64::from(t))).max().unwrap();
        assert!((9_900..=10_000).contains(&fullest), "{fullest}");
    }

    fn shares_of_long(take: &[(f64, f64, usize)]) -> Vec<usize> {
        let spans: Vec<Span> =
            take.iter().map(|&(start_s, duration_s, _)| Span { start_s, duration_s, level: 0 }).collect();
        budgets(10_000, &spans, &take.iter().map(|segment| segment.2).collect::<Vec<_>>())
    }
}
