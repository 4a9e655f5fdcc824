//! [`select`]: chooses the ranking whose Gaussians look most like the whole field.
//!
//! The whole field is the reference, so no ground truth is needed. Candidates with and without the
//! topology floor compete, so the floor costs nothing if a subject does not need it. Where pictures
//! cannot tell candidates apart, the topology decides: a thin limb covers few pixels, but viewers notice
//! a severed one.

use super::{Measure, Ranking, Retained};

/// PSNR differences up to this, in dB, are not significant: the effect of the floor varies by as much
/// from one set of pictures to another (measured on real fields at budgets of 5,000 to 40,000).
pub const RESOLUTION_DB: f64 = 0.1;

/// A candidate for the budget.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The ranking.
    pub ranking: Ranking,
    /// The retained rows, with or without the floor, and their topology.
    pub retained: Retained,
    /// PSNR in dB of the retained rows against the whole field.
    pub psnr_db: f64,
}

/// Result of [`select`].
#[derive(Clone, Debug)]
pub struct Selection {
    /// All candidates, in the order in which they were tried.
    pub candidates: Vec<Candidate>,
    /// Index of the best candidate.
    pub best: usize,
    /// Index of the candidate with the highest PSNR, on ties the first. It is the best, unless another
    /// one within [`RESOLUTION_DB`] preserves more of the topology.
    pub most_faithful: usize,
}

/// Tries each ranking. `prune` returns the candidates of a ranking; `judge` returns the PSNR in dB of rows against the
/// whole field. `None` if there are no candidates.
pub fn select(
    rankings: &[Ranking],
    mut prune: impl FnMut(Ranking) -> Vec<Retained>,
    mut judge: impl FnMut(&[usize]) -> f64,
) -> Option<Selection> {
    let mut candidates: Vec<Candidate> = Vec::new();
    for &ranking in rankings {
        for retained in prune(ranking) {
            let psnr_db = judge(&retained.rows);
            candidates.push(Candidate { ranking, retained, psnr_db });
        }
    }
    if candidates.is_empty() {
        return None;
    }
    let first_highest = |value: &dyn Fn(&Candidate) -> f64| {
        let higher = |best, i| if value(&candidates[i]) > value(&candidates[best]) { i } else { best };
        (1..candidates.len()).fold(0, higher)
    };
    let psnr = |candidate: &Candidate| {
        if candidate.psnr_db.is_nan() { f64::NEG_INFINITY } else { candidate.psnr_db }
    };
    let most_faithful = first_highest(&psnr);
    let least = psnr(&candidates[most_faithful]) - RESOLUTION_DB;
    let preserved = |candidate: &Candidate| match psnr(candidate) >= least {
        true => candidate.retained.topology.preserved(Measure::Strict),
        false => -1.0,
    };
    let most_preserved = preserved(&candidates[first_highest(&preserved)]);
    let best = first_highest(&|candidate| {
        if preserved(candidate) == most_preserved { psnr(candidate) } else { f64::NEG_INFINITY }
    });
    Some(Selection { candidates, best, most_faithful })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::Topology;

    /// A candidate whose single row is `name`, with `matched` of ten features.
    fn retained(name: usize, matched: usize) -> Retained {
        let topology = Topology { features: 10, found: matched, matched, ..Topology::default() };
        Retained { rows: vec![name], pruned: Topology::default(), topology, restored: 0 }
    }

    /// Selects among candidates given by PSNR and matched features, two per ranking.
    fn choice(candidates: &[(f64, usize)]) -> (usize, usize) {
        let rankings = &Ranking::ALL[..candidates.len().div_ceil(2)];
        let prune = |ranking| {
            let place = Ranking::ALL.iter().position(|other| *other == ranking).unwrap();
            (2 * place..candidates.len().min(2 * place + 2)).map(|i| retained(i, candidates[i].1)).collect()
        };
        let selection = select(rankings, prune, |rows| candidates[rows[0]].0).unwrap();
        assert_eq!(selection.candidates.len(), candidates.len());
        for (i, candidate) in selection.candidates.iter().enumerate() {
            assert_eq!((&candidate.retained.rows[..], candidate.ranking), (&[i][..], Ranking::ALL[i / 2]));
        }
        (selection.best, selection.most_faithful)
    }

    #[test]
    fn the_highest_psnr_wins_regardless_of_topology() {
        assert_eq!(choice(&[(30.0, 10), (31.0, 0), (30.8, 9), (29.0, 10)]), (1, 1));
        assert_eq!(choice(&[(30.0, 5)]), (0, 0));
    }

    #[test]
    fn topology_decides_within_the_resolution() {
        assert_eq!(choice(&[(30.0, 4), (29.95, 8), (29.85, 10)]), (1, 0));
        assert_eq!(choice(&[(29.95, 8), (30.0, 4), (29.97, 8)]), (2, 1), "then the higher PSNR");
        assert_eq!(choice(&[(30.0, 4), (30.0, 4)]), (0, 0), "on ties the first");
    }

    #[test]
    fn nan_and_infinite_psnr() {
        assert_eq!(choice(&[(f64::NAN, 10), (20.0, 1)]), (1, 1));
        assert_eq!(choice(&[(f64::INFINITY, 3), (60.0, 10), (f64::INFINITY, 4)]), (2, 0));
        assert_eq!(choice(&[(f64::NAN, 3), (f64::NAN, 4)]).1, 0);
    }

    #[test]
    fn no_ranking_selects_nothing() {
        assert!(select(&[], |_| Vec::new(), |_| 0.0).is_none());
    }
}
