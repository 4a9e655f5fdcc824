//! [`select`]: of several rankings, the one whose package looks most like the whole field.
//!
//! A ranking is a guess at what matters; pictures tell. The whole field is there to compare with,
//! so no ground truth is needed.

use super::{Kept, Ranking};

/// A ranking that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The ranking.
    pub ranking: Ranking,
    /// What it keeps, and what that preserves.
    pub kept: Kept,
    /// PSNR in dB of the finished package against the whole field.
    pub psnr_db: f64,
}

/// What [`select`] found.
#[derive(Clone, Debug)]
pub struct Selection<T> {
    /// Everything that was tried, in the order given.
    pub candidates: Vec<Candidate>,
    /// Index of the best candidate; the first of equals.
    pub best: usize,
    /// The best candidate's package.
    pub package: T,
}

/// Tries each ranking: `prune` says what it keeps, `package` makes a package of these rows and
/// tells its PSNR in dB against the whole field, as a player would show it. `None` if there are no
/// rankings.
///
/// # Errors
/// The first that `package` returns.
pub fn select<T, E>(
    rankings: &[Ranking],
    mut prune: impl FnMut(Ranking) -> Kept,
    mut package: impl FnMut(Ranking, &[usize]) -> Result<(T, f64), E>,
) -> Result<Option<Selection<T>>, E> {
    let mut selection: Option<Selection<T>> = None;
    for &ranking in rankings {
        let kept = prune(ranking);
        let (made, psnr_db) = package(ranking, &kept.rows)?;
        let candidate = Candidate { ranking, kept, psnr_db };
        match &mut selection {
            None => selection = Some(Selection { candidates: vec![candidate], best: 0, package: made }),
            Some(selection) => {
                if psnr_db > selection.candidates[selection.best].psnr_db {
                    selection.best = selection.candidates.len();
                    selection.package = made;
                }
                selection.candidates.push(candidate);
            }
        }
    }
    Ok(selection)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::Topology;

    fn keep(ranking: Ranking) -> Kept {
        let rows = vec![Ranking::ALL.iter().position(|other| *other == ranking).unwrap()];
        Kept { rows, pruned: Topology::default(), topology: Topology::default(), restored: 0 }
    }

    #[test]
    fn the_first_of_the_best_is_taken() {
        let psnr = [30.0, 31.0, 29.0, 31.0, f64::NAN, 30.0];
        let selection =
            select(&Ranking::ALL, keep, |_, rows| Ok::<_, ()>((rows[0], psnr[rows[0]]))).unwrap().unwrap();
        assert_eq!((selection.best, selection.package, selection.candidates.len()), (1, 1, 6));
        assert_eq!(selection.candidates[2].ranking, Ranking::Opacity);
        assert_eq!(selection.candidates[2].psnr_db, 29.0);
    }

    #[test]
    fn no_rankings_and_errors() {
        assert!(select(&[], keep, |_, _| Ok::<_, ()>(((), 0.0))).unwrap().is_none());
        assert_eq!(select(&Ranking::ALL, keep, |_, _| Err::<((), f64), _>("no")).err(), Some("no"));
    }
}
