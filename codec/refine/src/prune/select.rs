//! [`select`]: of several ways to meet a budget, the one whose package looks most like the whole
//! field.
//!
//! A ranking is a guess at what matters; pictures tell. The whole field is there to compare with,
//! so no ground truth is needed. What a ranking alone keeps and what the topology floor makes of it
//! compete, so the floor costs nothing where a subject does not hang on it. Where pictures cannot
//! tell packages apart, the topology decides: a thin limb is few pixels, and whoever walks around
//! the subject sees it come off.

use super::{Kept, Measure, Ranking};

/// Differences in PSNR up to this, in dB, do not tell packages apart. By so much the gain or loss
/// of the floor varies from one set of pictures to another (measured on real fields, at budgets
/// from 5,000 to 40,000).
pub const RESOLUTION_DB: f64 = 0.1;

/// A way to meet the budget that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The ranking.
    pub ranking: Ranking,
    /// What is kept, by the ranking alone or with the floor, and what that preserves.
    pub kept: Kept,
    /// PSNR in dB of the finished package against the whole field.
    pub psnr_db: f64,
}

/// What [`select`] found.
#[derive(Clone, Debug)]
pub struct Selection {
    /// Everything that was tried, in the order given.
    pub candidates: Vec<Candidate>,
    /// Index of the best candidate.
    pub best: usize,
    /// Index of the one of the highest PSNR, the first of equals. It is the best unless another
    /// preserves more of the topology and is within [`RESOLUTION_DB`] of it.
    pub most_faithful: usize,
}

/// Tries each ranking: `prune` says what may be kept by it, one or several ways; `judge` makes a
/// package of rows and tells its PSNR in dB against the whole field, as a player would show it.
/// `None` if there is nothing to try.
///
/// # Errors
/// The first that `judge` returns.
pub fn select<E>(
    rankings: &[Ranking],
    mut prune: impl FnMut(Ranking) -> Vec<Kept>,
    mut judge: impl FnMut(&[usize]) -> Result<f64, E>,
) -> Result<Option<Selection>, E> {
    let mut candidates: Vec<Candidate> = Vec::new();
    for &ranking in rankings {
        for kept in prune(ranking) {
            let psnr_db = judge(&kept.rows)?;
            candidates.push(Candidate { ranking, kept, psnr_db });
        }
    }
    if candidates.is_empty() {
        return Ok(None);
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
        true => candidate.kept.topology.preserved(Measure::Strict),
        false => -1.0,
    };
    let most_preserved = preserved(&candidates[first_highest(&preserved)]);
    let best = first_highest(&|candidate| {
        if preserved(candidate) == most_preserved { psnr(candidate) } else { f64::NEG_INFINITY }
    });
    Ok(Some(Selection { candidates, best, most_faithful }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::Topology;

    /// Rows that name a candidate, of ten features so many preserved.
    fn kept(name: usize, matched: usize) -> Kept {
        let topology = Topology { features: 10, found: matched, matched, ..Topology::default() };
        Kept { rows: vec![name], pruned: Topology::default(), topology, restored: 0 }
    }

    /// Selects among candidates given by their PSNR and the features preserved, two per ranking.
    fn of(candidates: &[(f64, usize)]) -> (usize, usize) {
        let rankings = &Ranking::ALL[..candidates.len().div_ceil(2)];
        let prune = |ranking| {
            let place = Ranking::ALL.iter().position(|other| *other == ranking).unwrap();
            (2 * place..candidates.len().min(2 * place + 2)).map(|i| kept(i, candidates[i].1)).collect()
        };
        let selection = select(rankings, prune, |rows| Ok::<_, ()>(candidates[rows[0]].0)).unwrap().unwrap();
        assert_eq!(selection.candidates.len(), candidates.len());
        for (i, candidate) in selection.candidates.iter().enumerate() {
            assert_eq!((&candidate.kept.rows[..], candidate.ranking), (&[i][..], Ranking::ALL[i / 2]));
        }
        (selection.best, selection.most_faithful)
    }

    #[test]
    fn the_most_faithful_wins_however_little_it_preserves() {
        assert_eq!(of(&[(30.0, 10), (31.0, 0), (30.8, 9), (29.0, 10)]), (1, 1));
        assert_eq!(of(&[(30.0, 5)]), (0, 0));
    }

    #[test]
    fn where_pictures_cannot_tell_the_topology_decides() {
        assert_eq!(of(&[(30.0, 4), (29.95, 8), (29.85, 10)]), (1, 0));
        assert_eq!(of(&[(29.95, 8), (30.0, 4), (29.97, 8)]), (2, 1), "of those the more faithful");
        assert_eq!(of(&[(30.0, 4), (30.0, 4)]), (0, 0), "of equals the first");
    }

    #[test]
    fn numbers_that_do_not_compare() {
        assert_eq!(of(&[(f64::NAN, 10), (20.0, 1)]), (1, 1));
        assert_eq!(of(&[(f64::INFINITY, 3), (60.0, 10), (f64::INFINITY, 4)]), (2, 0));
        assert_eq!(of(&[(f64::NAN, 3), (f64::NAN, 4)]).1, 0);
    }

    #[test]
    fn no_rankings_and_errors() {
        assert!(select(&[], |_| Vec::new(), |_| Ok::<_, ()>(0.0)).unwrap().is_none());
        let refuse = |_: &[usize]| Err::<f64, _>("no");
        assert_eq!(select(&Ranking::ALL, |_| vec![kept(0, 1)], refuse).err(), Some("no"));
    }
}
