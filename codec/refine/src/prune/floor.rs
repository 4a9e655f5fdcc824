//! The topology floor: prunes a field and restores the topology that pruning costs (the paper's
//! constrained budget).
//!
//! Pruning keeps the first Gaussians of a ranking. If that loses persistent features of the density, the
//! floor restores discarded Gaussians: at the maximum of a deleted feature, along the neck of a severed
//! one. It restores the Gaussian that adds most of the missing density first, on ties the
//! highest-ranked, and evicts the lowest-ranked others. The result is used only if it preserves strictly
//! more than the ranking alone.
//!
//! At budgets far below what a subject needs, features could use up the whole budget. Therefore the
//! cheapest features are restored first, and with a small fraction of the budget only.

use codec::{ALPHA_MIN, Field};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::density::{Grid, Kernel};
use super::persistence::{Connectivity, Feature, MergeTree};
use super::topology::{Matching, Measure, Topology};

/// Most rounds of restoring Gaussians and verifying the result.
pub const ROUNDS: usize = 4;

/// Greatest fraction of a budget that is restored against the ranking.
const RESTORED_MOST: f64 = 0.05;

/// Fewest and most voxels along the longest axis of the grid.
const VOXELS: std::ops::RangeInclusive<usize> = 8..=512;

/// Settings of a [`Floor`].
#[derive(Clone, Debug, PartialEq)]
pub struct FloorSettings {
    /// Reference instants in clip time, 0 to 1.
    pub instants: Vec<f64>,
    /// Voxels along the longest axis of the grid, 8 to 512.
    pub voxels: usize,
    /// Persistence threshold of a feature, as a fraction of the largest density at any reference
    /// instant: above 0, below 1.
    pub epsilon: f64,
    /// Which voxels are neighbours.
    pub connectivity: Connectivity,
    /// What counts as losing a feature.
    pub measure: Measure,
}

impl Default for FloorSettings {
    /// The start of the clip, 128 voxels, a threshold of 5 %, 26 neighbours, the strict measure.
    fn default() -> FloorSettings {
        FloorSettings {
            instants: vec![0.0],
            voxels: 128,
            epsilon: 0.05,
            connectivity: Connectivity::default(),
            measure: Measure::default(),
        }
    }
}

/// The topology of a field, the reference for its subsets.
pub struct Floor {
    settings: FloorSettings,
    grid: Grid,
    rows: usize,
    /// Largest density of the whole field, the unit of densities.
    largest: f32,
    instants: Vec<ReferenceInstant>,
}

/// The whole field at a reference instant.
struct ReferenceInstant {
    kernels: Vec<Kernel>,
    tree: MergeTree,
}

/// The rows that a budget retains.
#[derive(Clone, Debug, PartialEq)]
pub struct Retained {
    /// Retained rows, most important first.
    pub rows: Vec<usize>,
    /// Topology that the ranking alone preserves.
    pub pruned: Topology,
    /// Topology that `rows` preserve.
    pub topology: Topology,
    /// Number of rows that were restored against the ranking.
    pub restored: usize,
}

/// A voxel at which a subset lacks density.
struct Demand {
    voxel: [usize; 3],
    missing: f32,
}

/// The density that one feature lacks, and the rows that can supply it.
struct Gap {
    demands: Vec<Demand>,
    /// Discarded rows with density there: the position in the list of discarded rows, which is sorted
    /// by importance, and the density at each demand.
    candidates: Vec<(usize, Vec<f32>)>,
}

impl Floor {
    /// Computes the topology of `field`. The result does not depend on the number of threads.
    ///
    /// # Panics
    /// If a setting is out of range.
    pub fn new(field: &Field, settings: FloorSettings) -> Floor {
        assert!(settings.epsilon > 0.0 && settings.epsilon < 1.0, "a threshold of {}", settings.epsilon);
        assert!(VOXELS.contains(&settings.voxels), "{} voxels", settings.voxels);
        let grid = Grid::around(field, &settings.instants, settings.voxels);
        let instant = |&t: &f64| {
            let kernels = grid.kernels(field, t);
            let tree = MergeTree::new(grid.density(kernels.iter()), grid.size, settings.connectivity);
            ReferenceInstant { kernels, tree }
        };
        let instants: Vec<ReferenceInstant> = settings.instants.par_iter().map(instant).collect();
        let largest = instants.iter().map(|instant| instant.tree.largest()).fold(0.0, f32::max);
        Floor { settings, grid, rows: field.len(), largest, instants }
    }

    /// Number of persistent features, summed over the reference instants.
    pub fn features(&self) -> usize {
        self.instants.iter().map(|instant| instant.tree.persistent(self.epsilon()).len()).sum()
    }

    /// Topology of the field that `rows` preserve.
    pub fn verify(&self, rows: &[usize]) -> Topology {
        total(&self.compare(&self.flags(rows)))
    }

    /// Retains the first `budget` rows of `order`, or all if there are fewer, without a floor.
    pub fn leave(&self, order: &[usize], budget: usize) -> Retained {
        let rows = order[..budget.min(order.len())].to_vec();
        let topology = self.verify(&rows);
        Retained { rows, pruned: topology, topology, restored: 0 }
    }

    /// Retains `budget` rows of `order`, or all if there are fewer: the first ones, except those that the
    /// floor swaps. `order` contains each row of the field at most once, most important first. `on_verified` is
    /// called at most `1 + ROUNDS` times.
    pub fn enforce(&self, order: &[usize], budget: usize, mut on_verified: impl FnMut()) -> Retained {
        let budget = budget.min(order.len());
        let (head, tail) = order.split_at(budget);
        let mut retained = self.flags(head);
        let mut protected = vec![false; self.rows];
        let mut room = (RESTORED_MOST * budget as f64).ceil() as usize;
        let mut state = self.compare(&retained);
        on_verified();
        let pruned = total(&state);
        let mut best = Retained { rows: head.to_vec(), pruned, topology: pruned, restored: 0 };
        for _ in 0..ROUNDS {
            let discarded: Vec<usize> = order.iter().copied().filter(|&row| !retained[row]).collect();
            let back = self.restorable(&state, &discarded, room);
            if back.is_empty() {
                break;
            }
            room -= back.len();
            let evictable = head.iter().rev().copied().filter(|&row| retained[row] && !protected[row]);
            let out: Vec<usize> = evictable.take(back.len()).collect();
            for (&back, &out) in back.iter().zip(&out) {
                (retained[back], protected[back], retained[out]) = (true, true, false);
            }
            state = self.compare(&retained);
            on_verified();
            let topology = total(&state);
            let measure = self.settings.measure;
            if topology.preserved(measure) > best.topology.preserved(measure) {
                best.rows = order.iter().copied().filter(|&row| retained[row]).collect();
                best.restored = tail.iter().filter(|&&row| retained[row]).count();
                best.topology = topology;
            }
        }
        best
    }

    /// The candidates for a budget: the rows of the ranking alone, and the rows with the floor if it
    /// preserves more. Arguments as for [`Floor::enforce`].
    pub fn choices(&self, order: &[usize], budget: usize, on_verified: impl FnMut()) -> Vec<Retained> {
        let floored = self.enforce(order, budget, on_verified);
        if floored.restored == 0 {
            return vec![floored];
        }
        let rows = order[..budget.min(order.len())].to_vec();
        let pruned = floored.pruned;
        vec![Retained { rows, pruned, topology: pruned, restored: 0 }, floored]
    }

    fn epsilon(&self) -> f32 {
        (self.settings.epsilon * f64::from(self.largest)) as f32
    }

    fn flags(&self, rows: &[usize]) -> Vec<bool> {
        let mut flags = vec![false; self.rows];
        rows.iter().for_each(|&row| flags[row] = true);
        flags
    }

    /// Merge tree of the retained rows at each reference instant, and its matching with the whole.
    fn compare(&self, retained: &[bool]) -> Vec<(MergeTree, Matching)> {
        let compare = |instant: &ReferenceInstant| {
            let kernels = instant.kernels.iter().filter(|kernel| retained[kernel.row as usize]);
            let values = self.grid.density(kernels);
            let part = MergeTree::new(values, self.grid.size, self.settings.connectivity);
            let matching = Matching::new(&instant.tree, &part, self.epsilon(), self.largest);
            (part, matching)
        };
        self.instants.par_iter().map(compare).collect()
    }

    /// Selects at most `room` of the `discarded` rows, given most important first, to restore the
    /// features that `state` lacks.
    fn restorable(&self, state: &[(MergeTree, Matching)], discarded: &[usize], room: usize) -> Vec<usize> {
        let mut place = vec![usize::MAX; self.rows];
        discarded.iter().enumerate().for_each(|(i, &row)| place[row] = i);
        let mut gaps = Vec::new();
        for (instant, (part, matching)) in self.instants.iter().zip(state) {
            let demands = self.demands(&instant.tree, part, matching);
            gaps.par_extend(demands.into_par_iter().map(|demands| Gap::new(demands, instant, &place)));
        }
        let mut taken = vec![false; discarded.len()];
        let cost = |gap| Some((Gap::fill(gap, &taken, room)?.len(), gap));
        let mut cheapest: Vec<(usize, &Gap)> = gaps.par_iter().filter_map(cost).collect();
        cheapest.sort_by_key(|&(cost, _)| cost);
        let mut room = room;
        for (_, gap) in cheapest {
            if let Some(fill) = gap.fill(&taken, room) {
                room -= fill.len();
                fill.into_iter().for_each(|place| taken[place] = true);
            }
        }
        (0..discarded.len()).filter(|&place| taken[place]).map(|place| discarded[place]).collect()
    }

    /// The demands of each feature that the subset lacks.
    fn demands(&self, whole: &MergeTree, part: &MergeTree, matching: &Matching) -> Vec<Vec<Demand>> {
        let epsilon = self.epsilon();
        // A margin of half a threshold: the feature must survive the evictions, too.
        let spare = 0.5 * epsilon;
        let at_level = |voxels: &[usize], level: f32| -> Vec<Demand> {
            let demand = |&voxel: &usize| {
                let missing = level.min(whole.value(voxel)) - part.value(voxel);
                (missing > 0.0).then(|| Demand { voxel: self.grid.coordinates(voxel), missing })
            };
            voxels.iter().filter_map(demand).collect()
        };
        let mut demands = Vec::new();
        for &feature in &matching.deleted {
            let Feature { birth_voxel, death, .. } = whole.feature(feature);
            demands.push(at_level(&[birth_voxel], death + epsilon + spare));
        }
        if self.settings.measure == Measure::Strict {
            // The neck must be high enough that the persistence does not exceed the persistence in the whole.
            for &(feature, piece) in &matching.deepened {
                let persistence = whole.feature(feature).persistence();
                let level = part.feature(piece).birth - persistence - spare;
                demands.push(at_level(&whole.path_over_saddle(feature), level));
            }
            for &piece in &matching.split {
                let Feature { birth, birth_voxel, .. } = part.feature(piece);
                let mut basins = whole.basins_around(birth_voxel);
                if let Some(basin) = basins.find(|&basin| whole.feature(basin).persistence() > epsilon) {
                    demands.push(at_level(&whole.path(birth_voxel, basin), birth - spare));
                }
            }
        }
        demands
    }
}

impl Gap {
    /// `place` is the position of each row in the list of discarded rows, `usize::MAX` for others.
    fn new(demands: Vec<Demand>, instant: &ReferenceInstant, place: &[usize]) -> Gap {
        let candidate = |kernel: &Kernel| {
            let place = place[kernel.row as usize];
            if place == usize::MAX {
                return None;
            }
            let adds: Vec<f32> = demands.iter().map(|demand| kernel.at(demand.voxel)).collect();
            adds.iter().any(|&adds| f64::from(adds) >= ALPHA_MIN).then_some((place, adds))
        };
        let candidates = instant.kernels.iter().filter_map(candidate).collect();
        Gap { demands, candidates }
    }

    /// Greedily selects candidates that fill the gap together with the candidates already taken: the candidate that
    /// adds most of the missing density first, on ties the highest-ranked. `None` if that takes more than
    /// `most`.
    fn fill(&self, taken: &[bool], most: usize) -> Option<Vec<usize>> {
        let mut missing: Vec<f32> = self.demands.iter().map(|demand| demand.missing).collect();
        let subtract = |missing: &mut [f32], adds: &[f32]| {
            missing.iter_mut().zip(adds).for_each(|(missing, adds)| *missing -= adds);
        };
        for (_, adds) in self.candidates.iter().filter(|(place, _)| taken[*place]) {
            subtract(&mut missing, adds);
        }
        // The bits of non-negative floats sort like the floats.
        let filled = |missing: &[f32], adds: &[f32]| -> u32 {
            missing.iter().zip(adds).map(|(missing, adds)| adds.min(missing.max(0.0))).sum::<f32>().to_bits()
        };
        let free = self.candidates.iter().enumerate().filter(|(_, (place, _))| !taken[*place]);
        let mut by_gain: BinaryHeap<(u32, Reverse<usize>, usize)> =
            free.map(|(i, (place, adds))| (filled(&missing, adds), Reverse(*place), i)).collect();
        let mut fill = Vec::new();
        while let Some((gain, place, i)) = by_gain.pop() {
            if f64::from(f32::from_bits(gain)) < ALPHA_MIN {
                break;
            }
            // A stale gain: gains only fall as others fill the gap.
            let adds = &self.candidates[i].1;
            let now = filled(&missing, adds);
            if now < gain {
                by_gain.push((now, place, i));
                continue;
            }
            if fill.len() == most {
                return None;
            }
            subtract(&mut missing, adds);
            fill.push(place.0);
        }
        Some(fill)
    }
}

fn total(state: &[(MergeTree, Matching)]) -> Topology {
    let mut total = Topology::default();
    state.iter().for_each(|(_, matching)| total.add(&matching.topology));
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::{balls, cloud};
    use crate::prune::{Ranking, by_importance};

    /// Adds a block of `n^3` balls, `step` apart, to a field.
    fn block(field: &mut Field, corner: [f32; 3], n: usize, step: f32, sigma: f32, opacity: f32) {
        let at = |i: usize| [i % n, i / n % n, i / n / n].map(|k| k as f32 * step);
        let centers: Vec<[f32; 3]> =
            (0..n * n * n).map(at).map(|p| [0, 1, 2].map(|axis| corner[axis] + p[axis])).collect();
        append(field, &balls(&centers, sigma, opacity));
    }

    fn append(field: &mut Field, other: &Field) {
        field.centers.extend(&other.centers);
        field.rotations.extend(&other.rotations);
        field.log_scales.extend(&other.log_scales);
        field.opacities.extend(&other.opacities);
        field.sh.extend(&other.sh);
    }

    /// A body of 512 balls with 125 transparent ones inside, a thin arm of 30 balls, and a hand of 27 at
    /// its end. The arm has the least mass.
    fn limb() -> Field {
        let mut field = balls(&[], 0.1, 0.5);
        block(&mut field, [-0.875; 3], 8, 0.25, 0.15, 0.4);
        block(&mut field, [-0.5; 3], 5, 0.25, 0.2, 0.13);
        let arm: Vec<[f32; 3]> = (0..30).map(|i| [0.7 + 0.06 * i as f32, 0.0, 0.0]).collect();
        append(&mut field, &balls(&arm, 0.05, 0.5));
        block(&mut field, [2.5, -0.25, -0.25], 3, 0.25, 0.15, 0.4);
        field
    }

    fn by_mass(field: &Field) -> Vec<usize> {
        by_importance(&Ranking::Mass.scores(field, &[]))
    }

    fn floor_of(field: &Field, epsilon: f64, measure: Measure) -> Floor {
        Floor::new(field, FloorSettings { epsilon, measure, ..FloorSettings::default() })
    }

    fn are_distinct(rows: &[usize], len: usize) -> bool {
        let mut rows = rows.to_vec();
        rows.sort_unstable();
        rows.dedup();
        rows.len() == len
    }

    #[test]
    fn only_the_strict_measure_restores_a_severed_arm() {
        let field = limb();
        let order = by_mass(&field);
        let budget = field.len() - 30;
        assert!(order[budget..].iter().all(|row| (637..667).contains(row)), "mass discards the arm");
        let retained = floor_of(&field, 0.4, Measure::Strict).enforce(&order, budget, || ());
        let (before, after) = (retained.pruned, retained.topology);
        assert_eq!(before.features, 1, "one component");
        assert_eq!(
            (before.recall(), before.precision()),
            (1.0, 0.5),
            "recall does not see the hand come off"
        );
        assert_eq!((after.recall(), after.precision(), after.deepened), (1.0, 1.0, 0));
        assert!(retained.restored > 5 && retained.restored <= 30, "{} restored", retained.restored);
        assert!(are_distinct(&retained.rows, budget));

        let paper = floor_of(&field, 0.4, Measure::Recall).enforce(&order, budget, || ());
        assert_eq!((paper.rows.as_slice(), paper.restored), (&order[..budget], 0));
    }

    #[test]
    fn a_deleted_hand_is_restored() {
        let mut field = limb();
        // A small and opaque hand ranks below the transparent balls in the body.
        let hand = 667..694;
        for row in hand.clone() {
            field.log_scales[row] = [0.02f32.ln(); 3];
            field.opacities[row] = 1.0;
            field.centers[row] = [2.6 + 0.01 * (row % 3) as f32, 0.01 * (row % 5) as f32, 1.5];
        }
        let order = by_mass(&field);
        let budget = field.len() - 30 - 27;
        for measure in [Measure::Strict, Measure::Recall] {
            let retained = floor_of(&field, 0.05, measure).enforce(&order, budget, || ());
            assert!(retained.pruned.recall() < 1.0, "{:?}", retained.pruned);
            assert!(retained.topology.recall() > retained.pruned.recall(), "{:?}", retained.topology);
            assert!(retained.rows.iter().any(|row| hand.contains(row)));
            assert_eq!(retained.rows.len(), budget);
        }
    }

    /// 200 faint balls in one place, and 20 opaque ones, which rank last, in another.
    #[test]
    fn a_deleted_feature_takes_no_more_than_it_needs() {
        let mut field = balls(&[[0.0; 3]; 200], 0.1, 0.04);
        append(&mut field, &balls(&[[2.0, 0.0, 0.0]; 20], 0.1, 0.35));
        let order: Vec<usize> = (0..field.len()).collect();
        let retained = floor_of(&field, 0.1, Measure::Recall).enforce(&order, 200, || ());
        assert_eq!((retained.pruned.recall(), retained.topology.recall()), (0.5, 1.0));
        // One and a half thresholds are 1.2: 15 % of the largest density, 8.
        assert_eq!(retained.restored, 4);
    }

    #[test]
    fn a_severed_piece_is_joined_half_a_threshold_below_its_height() {
        let line: Vec<[f32; 3]> = (0..41).map(|i| [0.05 * i as f32, 0.0, 0.0]).collect();
        let floor = floor_of(&balls(&line, 0.1, 0.5), 0.2, Measure::Strict);
        let mut retained = vec![true; line.len()];
        retained[15..26].fill(false);
        let state = floor.compare(&retained);
        let (part, matching) = &state[0];
        let [piece] = matching.split[..] else { panic!("{:?}", matching.topology) };
        let [nx, ny, _] = floor.grid.size;
        let demands = floor.demands(&floor.instants[0].tree, part, matching);
        let level = |demand: &Demand| {
            let [x, y, z] = demand.voxel;
            part.value(x + nx * (y + ny * z)) + demand.missing
        };
        let highest = demands.iter().flatten().map(level).fold(0.0, f32::max);
        let expected = part.feature(piece).birth - 0.5 * floor.epsilon();
        assert!((highest - expected).abs() < 1e-4 * expected, "{highest} for {expected}");
    }

    #[test]
    fn the_floor_keeps_a_ranking_that_loses_nothing() {
        let field = limb();
        // The arm first; the discarded balls are the transparent ones inside the body.
        let scores: Vec<f64> =
            (0..field.len()).map(|row| if (512..637).contains(&row) { 0.0 } else { 1.0 }).collect();
        let order = by_importance(&scores);
        let floor = floor_of(&field, 0.4, Measure::Strict);
        let mut verified = 0;
        let retained = floor.enforce(&order, field.len() - 20, || verified += 1);
        assert_eq!(retained.pruned.preserved(Measure::Strict), 1.0, "{:?}", retained.pruned);
        assert_eq!(floor.leave(&order, field.len() - 20), retained);
        assert_eq!(
            (retained.rows.as_slice(), retained.restored, verified),
            (&order[..field.len() - 20], 0, 1)
        );
    }

    #[test]
    fn the_budget_is_exact_and_the_floor_preserves_more() {
        let field = cloud(7, 900);
        let instants = vec![0.25, 0.75];
        let floor = Floor::new(&field, FloorSettings { instants, voxels: 48, ..Default::default() });
        let order = by_importance(&Ranking::Mass.scores(&field, &[]));
        let mut restored = 0;
        for budget in [1, 40, 300, 700, 899] {
            let mut verified = 0;
            let retained = floor.enforce(&order, budget, || verified += 1);
            assert!(are_distinct(&retained.rows, budget));
            assert!(verified <= 1 + ROUNDS);
            assert_eq!(floor.verify(&order[..budget]), retained.pruned);
            assert_eq!(floor.verify(&retained.rows), retained.topology);
            let [before, after] = [retained.pruned, retained.topology].map(|t| t.preserved(Measure::Strict));
            assert!(if retained.restored > 0 { after > before } else { retained.rows == order[..budget] });
            let place = |row: &usize| order.iter().position(|other| other == row);
            assert!(retained.rows.is_sorted_by_key(place), "most important first");
            let choices = floor.choices(&order, budget, || ());
            let expected = [vec![floor.leave(&order, budget)], vec![retained.clone()]].concat();
            assert_eq!(choices, if retained.restored > 0 { expected } else { vec![retained.clone()] });
            assert_eq!(
                retained.rows.iter().filter(|row| !order[..budget].contains(row)).count(),
                retained.restored
            );
            restored += retained.restored;
        }
        assert!(restored > 0);
        let all = floor.enforce(&order, 5000, || ());
        assert_eq!((all.rows.len(), all.topology.preserved(Measure::Strict)), (900, 1.0));
        let none = floor.enforce(&order, 0, || ());
        assert_eq!((none.rows.len(), none.topology.recall()), (0, 0.0));
    }

    #[test]
    fn births_never_rise_under_pruning() {
        let field = cloud(8, 300);
        let floor = Floor::new(&field, FloorSettings { voxels: 40, ..Default::default() });
        let mut highest = f32::INFINITY;
        for count in [300, 200, 100, 20] {
            let mut retained = vec![false; 300];
            retained[..count].fill(true);
            let diagram = floor.compare(&retained)[0].0.diagram();
            assert!(diagram[0].birth <= highest && diagram[0].birth > 0.0);
            highest = diagram[0].birth;
        }
    }

    #[test]
    fn the_result_does_not_depend_on_threads() {
        let field = cloud(9, 700);
        let order = by_mass(&field);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let settings = FloorSettings { instants: vec![0.3, 0.6], voxels: 40, ..Default::default() };
            pool.install(|| Floor::new(&field, settings).enforce(&order, 300, || ()))
        };
        let one = on(1);
        assert!(one.restored > 0);
        assert_eq!(one, on(3));
    }

    #[test]
    fn degenerate_fields_meet_their_budget() {
        let one_instant = {
            let mut field = cloud(1, 40);
            let temporal = field.temporal.as_mut().unwrap();
            temporal.tau.fill(0.5);
            temporal.s.fill(1e-4);
            field
        };
        for (name, field) in [
            ("all transparent", balls(&[[0.0; 3], [1.0; 3]], 0.1, 0.0)),
            ("all in one point", balls(&[[2.0; 3]; 30], 0.1, 0.8)),
            ("one Gaussian", balls(&[[2.0; 3]], 0.1, 0.8)),
            ("none", balls(&[], 0.1, 0.8)),
            ("one instant", one_instant),
            ("too large", balls(&[[1e9; 3], [-1e9; 3]], 1e8, 0.8)),
        ] {
            let order = by_mass(&field);
            for instants in [vec![0.0, 0.5, 1.0], vec![]] {
                let floor = Floor::new(&field, FloorSettings { instants, voxels: 32, ..Default::default() });
                for budget in [0, 1, 2, 100] {
                    let retained = floor.enforce(&order, budget, || ());
                    assert!(are_distinct(&retained.rows, budget.min(field.len())), "{name}");
                    assert!((0.0..=1.0).contains(&retained.topology.recall()), "{name}");
                }
            }
        }
    }
}
