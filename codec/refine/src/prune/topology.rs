//! Compares the persistence diagrams of a field and a subset of it.
//!
//! A feature of the whole field is preserved if a feature of the subset is born in its basin. Matching by
//! position prevents a hand from standing in for a foot. Basins nest, so matching the innermost first
//! yields a maximum matching.
//!
//! Pruning lowers saddles as well as peaks. A severed limb is therefore not missing from the diagram: its
//! bar gets longer, or an additional bar appears. Recall, the paper's measure, does not detect this.

use super::persistence::MergeTree;

/// What counts as the loss of a feature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measure {
    /// Features that are deleted, and features that are severed from their neighbours.
    #[default]
    Strict,
    /// Features that are deleted (the paper's topology preservation rate).
    Recall,
}

/// Counts of features, summed over the reference instants.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Topology {
    /// Persistent features of the whole field.
    pub features: usize,
    /// Persistent features of the subset.
    pub found: usize,
    /// Features of the whole field with a match in the subset.
    pub matched: usize,
    /// Matched features that are severed: their persistence grew by more than the threshold.
    pub deepened: usize,
    /// Sum of `|death - death'|` over the matched features, in units of the largest density of the whole
    /// field.
    pub drift_sum: f64,
}

impl Topology {
    /// Fraction of the features that have a match, 0 to 1: the paper's preservation rate. 1 if there are no
    /// features.
    pub fn recall(&self) -> f64 {
        ratio(self.matched, self.features)
    }

    /// Fraction of the subset's features that match a feature of the whole field, 0 to 1; the others are
    /// severed pieces. 1 if the subset has none.
    pub fn precision(&self) -> f64 {
        ratio(self.matched, self.found)
    }

    /// Harmonic mean of recall and precision, 0 to 1.
    pub fn f1(&self) -> f64 {
        ratio(2 * self.matched, self.features + self.found)
    }

    /// Mean `|death - death'|` of the matched features, in units of the largest density.
    pub fn saddle_drift(&self) -> f64 {
        if self.matched == 0 { 0.0 } else { self.drift_sum / self.matched as f64 }
    }

    /// Fraction of the features preserved by `measure`, 0 to 1. Under the strict measure, a severed piece
    /// counts as an additional feature that is lost.
    pub fn preserved(&self, measure: Measure) -> f64 {
        match measure {
            Measure::Recall => self.recall(),
            Measure::Strict => ratio(self.matched - self.deepened, self.features + self.found - self.matched),
        }
    }

    pub(crate) fn add(&mut self, other: &Topology) {
        self.features += other.features;
        self.found += other.found;
        self.matched += other.matched;
        self.deepened += other.deepened;
        self.drift_sum += other.drift_sum;
    }
}

fn ratio(part: usize, whole: usize) -> f64 {
    if whole == 0 { 1.0 } else { part as f64 / whole as f64 }
}

/// Correspondence between the persistent features of a field and of a subset at one instant. Features are
/// identified by the numbers of their maxima.
pub(crate) struct Matching {
    /// Features of the whole field without a match.
    pub(crate) deleted: Vec<usize>,
    /// Matched but severed features: the feature of the whole field, and the feature of the subset.
    pub(crate) deepened: Vec<(usize, usize)>,
    /// Features of the subset without a match: severed pieces.
    pub(crate) split: Vec<usize>,
    /// The counts.
    pub(crate) topology: Topology,
}

impl Matching {
    /// Matches the features with persistence above `epsilon`. `largest` is the unit of densities.
    pub(crate) fn new(whole: &MergeTree, part: &MergeTree, epsilon: f32, largest: f32) -> Matching {
        let mut features = whole.persistent(epsilon);
        features.sort_by(|&a, &b| whole.by_saddle(a, b));
        // A basin with several features matches the most persistent one.
        let mut found = part.persistent(epsilon);
        let persistence = |&maximum: &usize| part.feature(maximum).persistence();
        found.sort_by(|a, b| persistence(b).total_cmp(&persistence(a)).then(a.cmp(b)));
        let place = |&maximum: &usize| part.feature(maximum).birth_voxel;
        let basins = |maximum: &usize| {
            let around = whole.basins_around(place(maximum));
            around.filter(|basin| features.binary_search_by(|f| whole.by_saddle(*f, *basin)).is_ok())
        };
        let mut free: Vec<(usize, Vec<usize>)> =
            found.iter().map(|maximum| (*maximum, basins(maximum).collect())).collect();

        let mut matching = Matching {
            deleted: Vec::new(),
            deepened: Vec::new(),
            split: Vec::new(),
            topology: Topology { features: features.len(), found: found.len(), ..Topology::default() },
        };
        for &feature in &features {
            let Some(at) = free.iter().position(|(_, basins)| basins.contains(&feature)) else {
                matching.deleted.push(feature);
                continue;
            };
            let (piece, _) = free.remove(at);
            let (before, after) = (whole.feature(feature), part.feature(piece));
            let topology = &mut matching.topology;
            topology.matched += 1;
            topology.drift_sum += f64::from((before.death - after.death).abs() / largest);
            if after.persistence() > before.persistence() + epsilon {
                topology.deepened += 1;
                matching.deepened.push((feature, piece));
            }
        }
        matching.split = free.into_iter().map(|(piece, _)| piece).collect();
        matching
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::Connectivity;

    fn tree(values: &[f32]) -> MergeTree {
        MergeTree::new(values.to_vec(), [values.len(), 1, 1], Connectivity::TwentySix)
    }

    fn compare(whole: &[f32], part: &[f32]) -> Topology {
        Matching::new(&tree(whole), &tree(part), 1.0, 10.0).topology
    }

    const BODY: [f32; 9] = [0.0, 8.0, 10.0, 8.0, 2.0, 4.0, 6.0, 5.0, 0.0];

    #[test]
    fn the_whole_field_preserves_all_and_the_empty_subset_none() {
        let all = compare(&BODY, &BODY);
        assert_eq!((all.features, all.found, all.matched, all.deepened), (2, 2, 2, 0));
        assert_eq!((all.recall(), all.precision(), all.f1(), all.saddle_drift()), (1.0, 1.0, 1.0, 0.0));
        assert_eq!(all.preserved(Measure::Strict), 1.0);
        let none = compare(&BODY, &[0.0; 9]);
        assert_eq!((none.recall(), none.precision(), none.f1()), (0.0, 1.0, 0.0));
        assert_eq!((none.preserved(Measure::Strict), none.preserved(Measure::Recall)), (0.0, 0.0));
        let empty = compare(&[0.0; 9], &[0.0; 9]);
        assert_eq!((empty.recall(), empty.preserved(Measure::Strict)), (1.0, 1.0));
    }

    #[test]
    fn a_deleted_hand_lowers_recall() {
        let t = compare(&BODY, &[0.0, 8.0, 10.0, 8.0, 2.0, 0.5, 0.5, 0.5, 0.0]);
        assert_eq!((t.recall(), t.precision(), t.f1()), (0.5, 1.0, 2.0 / 3.0));
        assert_eq!(t.preserved(Measure::Strict), 0.5);
    }

    #[test]
    fn a_severed_hand_keeps_recall_but_drifts() {
        let t = compare(&BODY, &[0.0, 8.0, 10.0, 8.0, 0.0, 4.0, 6.0, 5.0, 0.0]);
        assert_eq!((t.recall(), t.precision(), t.deepened), (1.0, 1.0, 1));
        assert!((t.saddle_drift() - 0.1).abs() < 1e-6);
        assert_eq!((t.preserved(Measure::Strict), t.preserved(Measure::Recall)), (0.5, 1.0));
    }

    #[test]
    fn a_split_limb_lowers_precision() {
        let limb = [0.0, 8.0, 10.0, 8.0, 7.0, 7.0, 7.5, 5.0, 0.0];
        let t = compare(&limb, &[0.0, 8.0, 10.0, 8.0, 1.0, 7.0, 7.5, 5.0, 0.0]);
        assert_eq!((t.features, t.found, t.recall(), t.precision()), (1, 2, 1.0, 0.5));
        assert_eq!((t.preserved(Measure::Strict), t.preserved(Measure::Recall)), (0.5, 1.0));
    }

    /// The hand's peak is now the highest; the body must not take its match.
    #[test]
    fn the_innermost_basin_is_matched_first() {
        let t = compare(&BODY, &[0.0, 4.0, 5.0, 4.0, 1.0, 4.0, 6.0, 5.0, 0.0]);
        assert_eq!((t.matched, t.recall(), t.precision()), (2, 1.0, 1.0));
    }
}
