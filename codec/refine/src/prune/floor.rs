//! The topology floor: prune, verify, restore, verify again (the paper's constraint on what a
//! budget may cost).
//!
//! A pruned field keeps the first Gaussians of a ranking. Where that loses persistent features of
//! the density, discarded Gaussians that made them up come back, those first that make up most of
//! what is missing, of equals the highest-ranked: at the maximum of a feature that is gone, along
//! the neck of one that is cut off. The lowest-ranked of the others leave in their place. The result
//! counts only if it preserves strictly more than the pruned field.
//!
//! Far below the number of Gaussians that a subject needs, whole budgets could go into features and
//! leave no picture. So the features that take the fewest Gaussians come back first, and only a
//! small part of a budget is spent on them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fmt;

use codec::{ALPHA_MIN, Field};
use rayon::prelude::*;

use super::density::{Grid, Kernel};
use super::persistence::{Connectivity, Feature, MergeTree};
use super::topology::{Matching, Measure, Topology};

/// Most times that Gaussians are restored and the result verified.
pub const ROUNDS: usize = 4;

/// Most of a budget that is restored in spite of its rank.
const RESTORED_MOST: f64 = 0.05;

/// Fewest and most voxels along the longest axis of the grid.
const VOXELS: std::ops::RangeInclusive<usize> = 8..=512;

/// What the floor preserves.
#[derive(Clone, Debug, PartialEq)]
pub struct FloorSettings {
    /// Reference instants in clip time.
    pub instants: Vec<f64>,
    /// Voxels along the longest axis of the grid, 8 to 512.
    pub voxels: usize,
    /// Least persistence of a feature that matters, as a part of the largest density at any
    /// reference instant: above 0, below 1.
    pub epsilon: f64,
    /// Which voxels touch each other.
    pub connectivity: Connectivity,
    /// What counts as losing a feature.
    pub measure: Measure,
}

impl Default for FloorSettings {
    /// The start of the clip, 128 voxels, 5 %, 26 neighbours, strict.
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

/// A setting out of range.
#[derive(Clone, Debug, PartialEq)]
pub enum FloorError {
    /// The threshold is not between 0 and 1.
    Epsilon(f64),
    /// The grid is too coarse or too fine.
    Voxels(usize),
}

impl fmt::Display for FloorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FloorError::Epsilon(epsilon) => {
                write!(f, "the persistence threshold must lie between 0 and 1, not at {epsilon}")
            }
            FloorError::Voxels(voxels) => {
                let (least, most) = (VOXELS.start(), VOXELS.end());
                write!(f, "the density grid needs {least} to {most} voxels along an axis, not {voxels}")
            }
        }
    }
}

impl std::error::Error for FloorError {}

/// The topology of a field, for its parts to be held against.
pub struct Floor {
    settings: FloorSettings,
    grid: Grid,
    rows: usize,
    /// Densities are compared with this: the largest of the whole field.
    largest: f32,
    frames: Vec<Frame>,
}

/// The whole field at a reference instant.
struct Frame {
    kernels: Vec<Kernel>,
    tree: MergeTree,
}

/// The Gaussians that a budget keeps.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// Their rows, most important first.
    pub rows: Vec<usize>,
    /// What pruning by the ranking alone preserves.
    pub pruned: Topology,
    /// What is preserved.
    pub topology: Topology,
    /// How many of the rows are there in spite of their rank.
    pub restored: usize,
}

/// A place where a part of the field is not dense enough.
struct Demand {
    voxel: [usize; 3],
    missing: f32,
}

/// What it takes to get one feature back.
struct Gap {
    demands: Vec<Demand>,
    /// Discarded Gaussians that make up the density there: their place among the discarded, which
    /// are given most important first, and what each adds to the demands.
    candidates: Vec<(usize, Vec<f32>)>,
}

impl Floor {
    /// Takes the topology of `field`. The same on any number of threads.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(field: &Field, settings: FloorSettings) -> Result<Floor, FloorError> {
        if !(settings.epsilon > 0.0 && settings.epsilon < 1.0) {
            return Err(FloorError::Epsilon(settings.epsilon));
        }
        if !VOXELS.contains(&settings.voxels) {
            return Err(FloorError::Voxels(settings.voxels));
        }
        let grid = Grid::around(field, &settings.instants, settings.voxels);
        let frame = |&t: &f64| {
            let kernels = grid.kernels(field, t);
            let tree = MergeTree::new(grid.density(kernels.iter()), grid.size, settings.connectivity);
            Frame { kernels, tree }
        };
        let frames: Vec<Frame> = settings.instants.par_iter().map(frame).collect();
        let largest = frames.iter().map(|frame| frame.tree.largest()).fold(0.0, f32::max);
        Ok(Floor { settings, grid, rows: field.len(), largest, frames })
    }

    /// Number of features to preserve, over all reference instants.
    pub fn features(&self) -> usize {
        self.frames.iter().map(|frame| frame.tree.persistent(self.epsilon()).len()).sum()
    }

    /// What the given rows of the field preserve of it.
    pub fn verify(&self, rows: &[usize]) -> Topology {
        total(&self.compare(&self.flags(rows)))
    }

    /// Keeps the first `budget` rows (or all, if there are fewer) of `order`, whatever that loses.
    pub fn leave(&self, order: &[usize], budget: usize) -> Kept {
        let rows = order[..budget.min(order.len())].to_vec();
        let topology = self.verify(&rows);
        Kept { rows, pruned: topology, topology, restored: 0 }
    }

    /// Keeps `budget` rows (or all, if there are fewer) of `order`, which holds each row of the
    /// field once, most important first: the first ones, but for those that the floor restores
    /// and evicts. `on_verified` is called at most `1 + ROUNDS` times.
    pub fn enforce(&self, order: &[usize], budget: usize, mut on_verified: impl FnMut()) -> Kept {
        let budget = budget.min(order.len());
        let (head, tail) = order.split_at(budget);
        let mut kept = self.flags(head);
        let mut protected = vec![false; self.rows];
        let mut room = (RESTORED_MOST * budget as f64).ceil() as usize;
        let mut state = self.compare(&kept);
        on_verified();
        let pruned = total(&state);
        let mut best = Kept { rows: head.to_vec(), pruned, topology: pruned, restored: 0 };
        for _ in 0..ROUNDS {
            let discarded: Vec<usize> = order.iter().copied().filter(|&row| !kept[row]).collect();
            let back = self.restorable(&state, &discarded, room);
            if back.is_empty() {
                break;
            }
            room -= back.len();
            let evictable = head.iter().rev().copied().filter(|&row| kept[row] && !protected[row]);
            let out: Vec<usize> = evictable.take(back.len()).collect();
            for (&back, &out) in back.iter().zip(&out) {
                (kept[back], protected[back], kept[out]) = (true, true, false);
            }
            state = self.compare(&kept);
            on_verified();
            let topology = total(&state);
            let measure = self.settings.measure;
            if topology.preserved(measure) > best.topology.preserved(measure) {
                best.rows = order.iter().copied().filter(|&row| kept[row]).collect();
                best.restored = tail.iter().filter(|&&row| kept[row]).count();
                best.topology = topology;
            }
        }
        best
    }

    /// What there is to choose from for a budget: what the ranking alone keeps, and, where that loses
    /// features of which the floor saves some, what the floor keeps. Arguments as for
    /// [`Floor::enforce`].
    pub fn choices(&self, order: &[usize], budget: usize, on_verified: impl FnMut()) -> Vec<Kept> {
        let floored = self.enforce(order, budget, on_verified);
        if floored.restored == 0 {
            return vec![floored];
        }
        let rows = order[..budget.min(order.len())].to_vec();
        let pruned = floored.pruned;
        vec![Kept { rows, pruned, topology: pruned, restored: 0 }, floored]
    }

    fn epsilon(&self) -> f32 {
        (self.settings.epsilon * f64::from(self.largest)) as f32
    }

    fn flags(&self, rows: &[usize]) -> Vec<bool> {
        let mut flags = vec![false; self.rows];
        rows.iter().for_each(|&row| flags[row] = true);
        flags
    }

    /// Each frame's part as kept, and how it matches the whole.
    fn compare(&self, kept: &[bool]) -> Vec<(MergeTree, Matching)> {
        let compare = |frame: &Frame| {
            let kernels = frame.kernels.iter().filter(|kernel| kept[kernel.row as usize]);
            let values = self.grid.density(kernels);
            let part = MergeTree::new(values, self.grid.size, self.settings.connectivity);
            let matching = Matching::new(&frame.tree, &part, self.epsilon(), self.largest);
            (part, matching)
        };
        self.frames.par_iter().map(compare).collect()
    }

    /// Which of the `discarded` rows, given most important first, to restore for what `state`
    /// lacks; at most `room`.
    fn restorable(&self, state: &[(MergeTree, Matching)], discarded: &[usize], room: usize) -> Vec<usize> {
        let mut place = vec![usize::MAX; self.rows];
        discarded.iter().enumerate().for_each(|(i, &row)| place[row] = i);
        let mut gaps = Vec::new();
        for (frame, (part, matching)) in self.frames.iter().zip(state) {
            let demands = self.demands(&frame.tree, part, matching);
            gaps.par_extend(demands.into_par_iter().map(|demands| Gap::new(demands, frame, &place)));
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

    /// Where a part of the field lacks density for its features to be those of the whole: one set
    /// of places per feature.
    fn demands(&self, whole: &MergeTree, part: &MergeTree, matching: &Matching) -> Vec<Vec<Demand>> {
        let epsilon = self.epsilon();
        // Half a threshold to spare: what is restored must count, also after others leave.
        let spare = 0.5 * epsilon;
        let at_level = |voxels: &[usize], level: f32| -> Vec<Demand> {
            let demand = |&voxel: &usize| {
                let missing = level.min(whole.value(voxel)) - part.value(voxel);
                (missing > 0.0).then(|| Demand { voxel: self.grid.place(voxel), missing })
            };
            voxels.iter().filter_map(demand).collect()
        };
        let mut demands = Vec::new();
        for &feature in &matching.deleted {
            let Feature { birth_voxel, death, .. } = whole.feature(feature);
            demands.push(at_level(&[birth_voxel], death + epsilon + spare));
        }
        if self.settings.measure == Measure::Strict {
            // A neck must be high enough for what it joins not to stand out more than it did.
            for &(feature, piece) in &matching.deepened {
                let stood_out = whole.feature(feature).persistence();
                let level = part.feature(piece).birth - stood_out - spare;
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
    /// `place` tells the place of a discarded row among the discarded.
    fn new(demands: Vec<Demand>, frame: &Frame, place: &[usize]) -> Gap {
        let candidate = |kernel: &Kernel| {
            let place = place[kernel.row as usize];
            if place == usize::MAX {
                return None;
            }
            let adds: Vec<f32> = demands.iter().map(|demand| kernel.at(demand.voxel)).collect();
            adds.iter().any(|&adds| f64::from(adds) >= ALPHA_MIN).then_some((place, adds))
        };
        let candidates = frame.kernels.iter().filter_map(candidate).collect();
        Gap { demands, candidates }
    }

    /// The places of those that fill the gap together with those already taken, the one that fills
    /// most of what is still missing first, of equals the highest-ranked; `None` if it takes more
    /// than `most`.
    fn fill(&self, taken: &[bool], most: usize) -> Option<Vec<usize>> {
        let mut missing: Vec<f32> = self.demands.iter().map(|demand| demand.missing).collect();
        let subtract = |missing: &mut [f32], adds: &[f32]| {
            missing.iter_mut().zip(adds).for_each(|(missing, adds)| *missing -= adds);
        };
        for (_, adds) in self.candidates.iter().filter(|(place, _)| taken[*place]) {
            subtract(&mut missing, adds);
        }
        // The bits of floats from 0 up rise with the value.
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
            // Others may have filled some of it since: gains only fall.
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

    /// A body of 512 balls with 125 faint ones inside, a thin arm of 30, and a hand of 27 at its
    /// end. The arm has the least mass.
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
        Floor::new(field, FloorSettings { epsilon, measure, ..FloorSettings::default() }).unwrap()
    }

    fn is_permutation_of_part(rows: &[usize], len: usize) -> bool {
        let mut rows = rows.to_vec();
        rows.sort_unstable();
        rows.dedup();
        rows.len() == len
    }

    #[test]
    fn a_severed_arm_grows_back_by_the_strict_measure_alone() {
        let field = limb();
        let order = by_mass(&field);
        let budget = field.len() - 30;
        assert!(order[budget..].iter().all(|row| (637..667).contains(row)), "mass discards the arm");
        let kept = floor_of(&field, 0.4, Measure::Strict).enforce(&order, budget, || ());
        let (before, after) = (kept.pruned, kept.topology);
        assert_eq!(before.features, 1, "all of one piece");
        assert_eq!(
            (before.recall(), before.precision()),
            (1.0, 0.5),
            "recall does not see the hand come off"
        );
        assert_eq!((after.recall(), after.precision(), after.deepened), (1.0, 1.0, 0));
        assert!(kept.restored > 5 && kept.restored <= 30, "{} restored", kept.restored);
        assert!(is_permutation_of_part(&kept.rows, budget));

        let paper = floor_of(&field, 0.4, Measure::Recall).enforce(&order, budget, || ());
        assert_eq!((paper.rows.as_slice(), paper.restored), (&order[..budget], 0));
    }

    #[test]
    fn a_deleted_hand_grows_back() {
        let mut field = limb();
        // Hand and arm swap ranks with the faint balls in the body: the hand is small and bright.
        let hand = 667..694;
        for row in hand.clone() {
            field.log_scales[row] = [0.02f32.ln(); 3];
            field.opacities[row] = 1.0;
            field.centers[row] = [2.6 + 0.01 * (row % 3) as f32, 0.01 * (row % 5) as f32, 3.0];
        }
        let order = by_mass(&field);
        let budget = field.len() - 30 - 27;
        for measure in [Measure::Strict, Measure::Recall] {
            let kept = floor_of(&field, 0.05, measure).enforce(&order, budget, || ());
            assert!(kept.pruned.recall() < 1.0, "{:?}", kept.pruned);
            assert!(kept.topology.recall() > kept.pruned.recall(), "{:?}", kept.topology);
            assert!(kept.rows.iter().any(|row| hand.contains(row)));
            assert_eq!(kept.rows.len(), budget);
        }
    }

    #[test]
    fn where_the_ranking_is_safe_the_floor_does_nothing() {
        let field = limb();
        // The arm first; what is discarded is faint and inside the body.
        let scores: Vec<f64> =
            (0..field.len()).map(|row| if (512..637).contains(&row) { 0.0 } else { 1.0 }).collect();
        let order = by_importance(&scores);
        let floor = floor_of(&field, 0.4, Measure::Strict);
        let mut verified = 0;
        let kept = floor.enforce(&order, field.len() - 20, || verified += 1);
        assert_eq!(kept.pruned.preserved(Measure::Strict), 1.0, "{:?}", kept.pruned);
        assert_eq!(floor.leave(&order, field.len() - 20), kept);
        assert_eq!((kept.rows.as_slice(), kept.restored, verified), (&order[..field.len() - 20], 0, 1));
    }

    #[test]
    fn the_budget_is_exact_and_more_is_preserved() {
        let field = cloud(7, 900);
        let instants = vec![0.25, 0.75];
        let floor = Floor::new(&field, FloorSettings { instants, voxels: 48, ..Default::default() }).unwrap();
        let order = by_importance(&Ranking::Mass.scores(&field, &[]));
        let mut restored = 0;
        for budget in [1, 40, 300, 700, 899] {
            let mut verified = 0;
            let kept = floor.enforce(&order, budget, || verified += 1);
            assert!(is_permutation_of_part(&kept.rows, budget));
            assert!(verified <= 1 + ROUNDS);
            assert_eq!(floor.verify(&order[..budget]), kept.pruned);
            assert_eq!(floor.verify(&kept.rows), kept.topology);
            let [before, after] = [kept.pruned, kept.topology].map(|t| t.preserved(Measure::Strict));
            assert!(if kept.restored > 0 { after > before } else { kept.rows == order[..budget] });
            let place = |row: &usize| order.iter().position(|other| other == row);
            assert!(kept.rows.is_sorted_by_key(place), "most important first");
            let choices = floor.choices(&order, budget, || ());
            let expected = [vec![floor.leave(&order, budget)], vec![kept.clone()]].concat();
            assert_eq!(choices, if kept.restored > 0 { expected } else { vec![kept.clone()] });
            assert_eq!(kept.rows.iter().filter(|row| !order[..budget].contains(row)).count(), kept.restored);
            restored += kept.restored;
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
        let floor = Floor::new(&field, FloorSettings { voxels: 40, ..Default::default() }).unwrap();
        let mut highest = f32::INFINITY;
        for count in [300, 200, 100, 20] {
            let mut kept = vec![false; 300];
            kept[..count].fill(true);
            let diagram = floor.compare(&kept)[0].0.diagram();
            assert!(diagram[0].birth <= highest && diagram[0].birth > 0.0);
            highest = diagram[0].birth;
        }
    }

    #[test]
    fn threads_do_not_show() {
        let field = cloud(9, 700);
        let order = by_mass(&field);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let settings = FloorSettings { instants: vec![0.3, 0.6], voxels: 40, ..Default::default() };
            pool.install(|| Floor::new(&field, settings).unwrap().enforce(&order, 300, || ()))
        };
        let one = on(1);
        assert!(one.restored > 0);
        assert_eq!(one, on(3));
    }

    #[test]
    fn degenerate_fields_keep_their_budget() {
        let one_instant = {
            let mut field = cloud(1, 40);
            let temporal = field.temporal.as_mut().unwrap();
            temporal.tau.fill(0.5);
            temporal.s.fill(1e-4);
            field
        };
        for (what, field) in [
            ("all transparent", balls(&[[0.0; 3], [1.0; 3]], 0.1, 0.0)),
            ("all in one point", balls(&[[2.0; 3]; 30], 0.1, 0.8)),
            ("one Gaussian", balls(&[[2.0; 3]], 0.1, 0.8)),
            ("none", balls(&[], 0.1, 0.8)),
            ("one instant", one_instant),
            ("too large", balls(&[[1e9; 3], [-1e9; 3]], 1e8, 0.8)),
        ] {
            let order = by_mass(&field);
            for instants in [vec![0.0, 0.5, 1.0], vec![]] {
                let floor =
                    Floor::new(&field, FloorSettings { instants, voxels: 32, ..Default::default() }).unwrap();
                for budget in [0, 1, 2, 100] {
                    let kept = floor.enforce(&order, budget, || ());
                    assert!(is_permutation_of_part(&kept.rows, budget.min(field.len())), "{what}");
                    assert!((0.0..=1.0).contains(&kept.topology.recall()), "{what}");
                }
            }
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let field = balls(&[[0.0; 3]], 0.1, 0.5);
        let with = |settings: FloorSettings| Floor::new(&field, settings).err();
        for epsilon in [0.0, -0.1, 1.0, 7.0, f64::INFINITY] {
            let error = with(FloorSettings { epsilon, ..Default::default() }).unwrap();
            assert_eq!(error, FloorError::Epsilon(epsilon));
            assert!(error.to_string().contains("between 0 and 1"));
        }
        assert!(with(FloorSettings { epsilon: f64::NAN, ..Default::default() }).is_some());
        for voxels in [0, 7, 513] {
            assert_eq!(
                with(FloorSettings { voxels, ..Default::default() }),
                Some(FloorError::Voxels(voxels))
            );
        }
    }
}
