//! [`choose`]: quantiser indices that take few bits, near those that sensitivities ask for.
//!
//! The indices of a Gaussian are coded given its predecessor's. Steps that are half an octave off lose little, so
//! runs of the same indices pay. `n` numbers whose steps are `e^x` times the best ones take `n x / ln 2` bits fewer, and
//! have `e^2x` times the squared error. At the best steps a bit is worth `2 ln 2` times the squared error of a number, so
//! all that costs as much as this number of bits:
//!
//! ```text
//! n ((e^2x - 1) / 2 - x) / ln 2
//! ```
//!
//! The sum of that and of the bits of the indices is least along a shortest path from Gaussian to Gaussian.

use std::f64::consts::LN_2;

use super::row::{GEOMETRY_BITS, GEOMETRY_CONTEXTS, VISIBILITY_BITS, geometry_context};
use crate::rans::math;

/// Visibility and geometry index of a Gaussian.
pub(super) type Indices = [u32; 2];

/// Largest indices.
const VISIBILITY_MAX: f64 = ((1 << VISIBILITY_BITS) - 1) as f64;
const GEOMETRY_MAX: f64 = ((1 << GEOMETRY_BITS) - 1) as f64;

/// Number of searches. Each takes the bits from the indices of its predecessor; a third search changed next to nothing.
const SEARCHES: usize = 2;

/// Count of an index that does not occur. Bits of counts are finite then.
const UNSEEN_COUNT: f64 = 0.15;

/// The indices nearest to the `ideal` colour step and geometry step, in half octaves from the finest colour step.
pub(super) fn nearest([color, geometry]: [f64; 2]) -> Indices {
    let visibility = math::round(color).clamp(0.0, VISIBILITY_MAX);
    [visibility as u32, math::round(geometry - visibility).clamp(0.0, GEOMETRY_MAX) as u32]
}

/// Chooses the indices of Gaussians in the order in which they are coded. `ideal` are their steps, as [`nearest`] takes
/// them; `numbers` is how many numbers of a Gaussian are coded with each of the two steps.
pub(super) fn choose(ideal: &[[f64; 2]], numbers: [f64; 2]) -> Vec<Indices> {
    let first = ideal.iter().map(|&ideal| nearest(ideal)).collect();
    (0..SEARCHES).fold(first, |indices: Vec<Indices>, _| cheapest(ideal, numbers, &IndexBits::new(&indices)))
}

/// A choice for a Gaussian.
struct Candidate {
    indices: Indices,
    /// Cost in bits of the best choices up to this one.
    cost: f64,
    /// Place of the best choice for the Gaussian before.
    before: usize,
}

/// The indices of the least cost, given the bits of each.
fn cheapest(ideal: &[[f64; 2]], numbers: [f64; 2], bits: &IndexBits) -> Vec<Indices> {
    // Coding starts as if after a Gaussian with these indices.
    let mut path = vec![Candidate { indices: [0; 2], cost: 0.0, before: 0 }];
    let mut last = 0..1;
    for ideal in ideal {
        for indices in candidates(*ideal) {
            let costs = last.clone().map(|before| {
                let Candidate { indices: last, cost, .. } = path[before];
                (before, cost + bits.of_next(last, indices))
            });
            let (before, cost) = costs.min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are candidates");
            let steps = [f64::from(indices[0]), f64::from(indices[0] + indices[1])];
            let excess: f64 = (0..2).map(|k| numbers[k] * excess_bits(steps[k] - ideal[k])).sum();
            path.push(Candidate { indices, cost: cost + excess, before });
        }
        last = last.end..path.len();
    }
    let mut at = last.min_by(|&a, &b| path[a].cost.total_cmp(&path[b].cost)).expect("there are candidates");
    let mut chosen = Vec::with_capacity(ideal.len());
    while at > 0 {
        chosen.push(path[at].indices);
        at = path[at].before;
    }
    chosen.reverse();
    chosen
}

/// The visibility indices next to the ideal one, each with the geometry indices on both sides of the ideal one.
fn candidates([color, geometry]: [f64; 2]) -> impl Iterator<Item = Indices> {
    let rounded = math::round(color).clamp(0.0, VISIBILITY_MAX);
    let visibilities = [-1.0, 0.0, 1.0].map(|by| rounded + by).into_iter();
    visibilities.filter(|visibility| (0.0..=VISIBILITY_MAX).contains(visibility)).flat_map(
        move |visibility| {
            let below = (geometry - visibility).clamp(0.0, GEOMETRY_MAX) as u32;
            let end = (below + 1).min(GEOMETRY_MAX as u32);
            (below..=end).map(move |geometry| [visibility as u32, geometry])
        },
    )
}

/// Cost in bits of each number whose step is off by this number of half octaves.
fn excess_bits(halves: f64) -> f64 {
    let x = halves * 0.5 * LN_2;
    (0.5 * (math::exp(2.0 * x) - 1.0) - x) / LN_2
}

/// Bits that indices take after others, once models have adapted.
struct IndexBits {
    /// `[last visibility][visibility]`
    visibility: Vec<Vec<f64>>,
    /// `[context][geometry]`
    geometry: Vec<Vec<f64>>,
}

impl IndexBits {
    /// Bits of indices as frequent as these.
    fn new(indices: &[Indices]) -> IndexBits {
        let mut visibility_counts = vec![vec![UNSEEN_COUNT; 1 << VISIBILITY_BITS]; 1 << VISIBILITY_BITS];
        let mut geometry_counts = vec![vec![UNSEEN_COUNT; 1 << GEOMETRY_BITS]; GEOMETRY_CONTEXTS];
        let mut last = [0; 2];
        for &indices in indices {
            let [visibility, geometry] = indices;
            visibility_counts[last[0] as usize][visibility as usize] += 1.0;
            geometry_counts[geometry_context(visibility, last[1])][geometry as usize] += 1.0;
            last = indices;
        }
        let bits = |counts: Vec<f64>| {
            let total: f64 = counts.iter().sum();
            counts.iter().map(|count| math::ln(total / count) / LN_2).collect()
        };
        IndexBits {
            visibility: visibility_counts.into_iter().map(bits).collect(),
            geometry: geometry_counts.into_iter().map(bits).collect(),
        }
    }

    fn of_next(&self, last: Indices, [visibility, geometry]: Indices) -> f64 {
        self.visibility[last[0] as usize][visibility as usize]
            + self.geometry[geometry_context(visibility, last[1])][geometry as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits of indices and of steps that are off.
    fn cost(ideal: &[[f64; 2]], numbers: [f64; 2], indices: &[Indices]) -> f64 {
        let bits = IndexBits::new(indices);
        let mut last = [0; 2];
        let mut sum = 0.0;
        for (ideal, &next) in ideal.iter().zip(indices) {
            sum += bits.of_next(last, next);
            sum += numbers[0] * excess_bits(f64::from(next[0]) - ideal[0]);
            sum += numbers[1] * excess_bits(f64::from(next[0] + next[1]) - ideal[1]);
            last = next;
        }
        sum
    }

    fn noise(count: usize) -> Vec<[f64; 2]> {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        (0..count).map(|_| [8.0 + 3.0 * random(), 12.0 + 3.0 * random()]).collect()
    }

    #[test]
    fn indices_near_the_ideal_ones_cost_less_than_the_nearest() {
        let ideal = noise(2000);
        let numbers = [3.0, 10.0];
        let nearest: Vec<Indices> = ideal.iter().map(|&ideal| nearest(ideal)).collect();
        let chosen = choose(&ideal, numbers);
        assert_eq!(chosen.len(), ideal.len());
        let [before, after] = [&nearest, &chosen].map(|indices| cost(&ideal, numbers, indices));
        assert!(after < 0.8 * before, "{before} {after}");
        for (ideal, [visibility, geometry]) in ideal.iter().zip(chosen) {
            let off = [f64::from(visibility) - ideal[0], f64::from(visibility + geometry) - ideal[1]];
            assert!(off[0].abs() <= 1.5 && off[1].abs() <= 1.0, "{ideal:?} {off:?}");
        }
    }

    #[test]
    fn many_numbers_take_the_best_steps() {
        let ideal = noise(500);
        for (ideal, [visibility, geometry]) in ideal.iter().zip(choose(&ideal, [1e6, 1e6])) {
            let off = [f64::from(visibility) - ideal[0], f64::from(visibility + geometry) - ideal[1]];
            // Coarser steps lose a little more than finer ones.
            assert!(off.iter().all(|halves| (-0.6..0.5).contains(halves)), "{ideal:?} {off:?}");
        }
    }

    #[test]
    fn any_steps_have_indices_in_range() {
        let ideal = [[-3.0, -9.0], [40.0, -9.0], [40.0, 90.0], [0.0, 90.0], [31.0, 31.4]];
        for [visibility, geometry] in choose(&ideal, [3.0, 10.0]) {
            assert!(visibility < 32 && geometry < 16);
        }
        assert!(choose(&[], [3.0, 10.0]).is_empty());
    }
}
