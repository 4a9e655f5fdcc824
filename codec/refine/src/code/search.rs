//! [`Search`]: finds the coarsest precision whose package meets a target PSNR.
//!
//! The PSNR of a large field's package rises nearly in proportion to the precision. The search moves by the missing
//! decibels over [`SLOPE`] until the target lies between two trials, then halves the distance between them where a
//! straight line through both does not lead on.

use crate::prune::Fidelity;

/// Most packages that a search encodes.
pub const TRIALS: usize = 14;

/// Accepted excess over the target PSNR, in dB.
pub const SURPLUS_MAX_DB: f64 = 0.3;

/// Most that a picture may be below the target PSNR, in dB.
pub const WORST_BELOW_DB: f64 = 6.0;

/// Excess that the search aims at, in dB.
const AIM_DB: f64 = 0.05;

/// Assumed gain in PSNR per gain in precision. From the first trial to the second it was 0.81 to 0.97 for spinach with
/// 20,000 and 40,000 Gaussians and all, and 0.86 for the guitar.
pub(super) const SLOPE: f64 = 0.83;

/// Excess in dB that ends the search; a larger accepted one is improved while trials are cheap.
const CLOSE_DB: f64 = 0.12;

/// Number of trials after which any accepted excess ends the search.
const CHEAP_TRIALS: usize = 4;

/// Assumed excess in dB where all pictures are equal.
const EQUAL_DB: f64 = 20.0;

/// Distance in dB of precision below which two trials have no other between them.
const RESOLUTION_DB: f64 = 0.02;

/// Finest precision in dB. Beyond it, numbers of ordinary fields exceed the coder's range.
const FINEST_DB: f64 = 130.0;

/// Why a package does not have the target PSNR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Miss {
    /// The finest precision of the coder is below the target.
    Below,
    /// The PSNR is at the target or above; the next coarser precision is below it.
    Above,
    /// The PSNR is above the target, for the worst picture would be more than [`WORST_BELOW_DB`] below the
    /// target otherwise.
    AboveForWorst,
}

/// How a package of this fidelity misses a target; `None` if it meets it.
pub(super) fn miss_of(fidelity: &Fidelity, target_db: f64) -> Option<Miss> {
    let mean_db = fidelity.psnr_db - target_db;
    let surplus_db = surplus_db(fidelity, target_db);
    if surplus_db < 0.0 {
        Some(Miss::Below)
    } else if surplus_db > SURPLUS_MAX_DB {
        Some(Miss::Above)
    } else if mean_db > SURPLUS_MAX_DB {
        Some(Miss::AboveForWorst)
    } else {
        None
    }
}

/// PSNR above the target in dB, or the worst picture's PSNR above its own target, if it is less; [`EQUAL_DB`] at most.
pub(super) fn surplus_db(fidelity: &Fidelity, target_db: f64) -> f64 {
    let worst = fidelity.worst.as_ref().map_or(f64::INFINITY, |worst| worst.psnr_db + WORST_BELOW_DB);
    (fidelity.psnr_db.min(worst) - target_db).min(EQUAL_DB)
}

/// A precision that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Trial {
    precision_db: f64,
    /// PSNR above the target, in dB.
    surplus_db: f64,
    bytes: usize,
}

/// A search for the precision of a target PSNR.
#[derive(Debug)]
pub(super) struct Search {
    target_db: f64,
    trials: usize,
    /// The finest trial below the target.
    below: Option<Trial>,
    /// The coarsest trial that meets the target.
    above: Option<Trial>,
    /// Precision of the next trial; `None` at the end.
    next_db: Option<f64>,
}

impl Search {
    pub(super) fn new(target_db: f64) -> Search {
        Search { target_db, trials: 0, below: None, above: None, next_db: Some(target_db) }
    }

    /// Precision in dB of the next trial; `None` at the end of the search.
    pub(super) fn next(&self) -> Option<f64> {
        self.next_db
    }

    /// Records the result of the trial at [`Search::next`], and tells how it misses the target.
    pub(super) fn record(&mut self, fidelity: &Fidelity, bytes: usize) -> Option<Miss> {
        let surplus_db = surplus_db(fidelity, self.target_db);
        let precision_db = self.next_db.take().expect("the search goes on");
        let trial = Trial { precision_db, surplus_db, bytes };
        self.trials += 1;
        // Without a gain from a finer precision, no precision helps.
        let is_stuck = surplus_db < 0.0
            && self.below.is_some_and(|below| bytes == below.bytes && precision_db > below.precision_db);
        match surplus_db < 0.0 {
            true if self.below.is_none_or(|below| precision_db > below.precision_db) => {
                self.below = Some(trial);
            }
            false if self.above.is_none_or(|above| precision_db < above.precision_db) => {
                self.above = Some(trial);
            }
            _ => {}
        }
        let limit = if self.trials < CHEAP_TRIALS { CLOSE_DB } else { SURPLUS_MAX_DB };
        let is_met = (0.0..limit).contains(&surplus_db);
        if !is_met && !is_stuck && self.trials < TRIALS {
            self.next_db = self.propose(trial);
        }
        miss_of(fidelity, self.target_db)
    }

    /// The precision to try after `last`; `None` if none is left between two trials, or at the finest.
    fn propose(&self, last: Trial) -> Option<f64> {
        let (below, above) = match (self.below, self.above) {
            (Some(below), Some(above)) => (below, above),
            _ => {
                // Steps grow, for where a column is at its finest the PSNR rises slowly.
                let growth = f64::from(1 << (self.trials - 1).min(4) as u32).sqrt();
                let step_db = (AIM_DB - last.surplus_db) / SLOPE * growth;
                let next_db = (last.precision_db + step_db).clamp(0.0, FINEST_DB);
                return (next_db != last.precision_db).then_some(next_db);
            }
        };
        // Noise: a finer trial that is below, and a coarser one that is not.
        let width_db = above.precision_db - below.precision_db;
        if width_db <= RESOLUTION_DB {
            return None;
        }
        let slope = (above.surplus_db - below.surplus_db) / width_db;
        let straight_db = below.precision_db + (AIM_DB - below.surplus_db) / slope;
        let margin_db = 0.1 * width_db;
        let next_db = match self.trials.is_multiple_of(3) {
            // Steps in the PSNR would let a straight line creep.
            true => below.precision_db + 0.5 * width_db,
            false => straight_db.clamp(below.precision_db + margin_db, above.precision_db - margin_db),
        };
        Some(next_db)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Searches on a PSNR over precision; returns the PSNR of the coarsest trial that is not below, its miss,
    /// and the number of trials.
    fn search(target_db: f64, psnr_of: impl Fn(f64) -> f64) -> (Option<f64>, Option<Miss>, usize) {
        let mut search = Search::new(target_db);
        let (mut found, mut trials) = (None, 0);
        let mut least = usize::MAX;
        let mut last = None;
        while let Some(precision_db) = search.next() {
            let psnr_db = psnr_of(precision_db);
            let fidelity = Fidelity { psnr_db, covered_psnr_db: psnr_db, worst: None };
            let bytes = (psnr_db * 100.0) as usize;
            let miss = search.record(&fidelity, bytes);
            if miss != Some(Miss::Below) && (found.is_none() || bytes < least) {
                (least, found, last) = (bytes, Some(psnr_db), miss);
            } else if found.is_none() {
                last = miss;
            }
            trials += 1;
        }
        (found, last, trials)
    }

    #[test]
    fn any_smooth_response_is_met_within_the_tolerance() {
        for (offset, slope) in [(0.0, 1.0), (7.0, 1.0), (-9.0, 1.0), (3.0, 0.5), (-12.0, 0.4), (-5.0, 1.8)] {
            for target_db in [20.0, 45.0, 50.7, 80.0] {
                let response = |precision: f64| target_db + offset + slope * (precision - target_db);
                let (found, miss, trials) = search(target_db, response);
                let surplus_db = found.unwrap() - target_db;
                assert!((0.0..=SURPLUS_MAX_DB).contains(&surplus_db), "{offset} {slope}: {surplus_db}");
                assert!(miss.is_none() && trials <= 9, "{offset} {slope}: {trials} trials");
            }
        }
    }

    #[test]
    fn an_accepted_excess_is_improved_while_trials_are_cheap() {
        let (found, miss, trials) = search(50.0, |precision| precision + 0.2);
        assert!(found.unwrap() < 50.0 + CLOSE_DB && miss.is_none() && trials == 2, "{found:?} {trials}");
    }

    /// Straight lines alone end 0.07 dB beside it.
    #[test]
    fn a_step_is_found_to_the_resolution() {
        let least = std::cell::Cell::new(f64::INFINITY);
        search(50.0, |precision| {
            let is_met = precision >= 53.7;
            if is_met {
                least.set(least.get().min(precision));
            }
            0.05 * precision + if is_met { 48.5 } else { 47.0 }
        });
        assert!(least.get() < 53.7 + RESOLUTION_DB, "{}", least.get());
    }

    #[test]
    fn steps_give_the_next_higher_one_and_say_so() {
        let (found, miss, _) = search(50.7, |precision| (precision / 4.0).floor() * 4.0);
        assert_eq!((found, miss), (Some(52.0), Some(Miss::Above)));
        let (found, miss, _) = search(50.7, |_| f64::INFINITY);
        assert_eq!((found, miss), (Some(f64::INFINITY), Some(Miss::Above)));
    }

    #[test]
    fn a_ceiling_below_the_target_ends_the_search() {
        let (found, miss, trials) = search(50.7, |precision| precision.min(44.6));
        assert_eq!((found, miss), (None, Some(Miss::Below)));
        assert!(trials <= 3, "{trials}");
    }

    #[test]
    fn the_worst_picture_asks_for_more() {
        let mut search = Search::new(50.0);
        let camera = codec::Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 8, 8);
        let view = crate::reference::PosedView { camera, t: 0.0 };
        let mut misses = Vec::new();
        while let Some(precision_db) = search.next() {
            let worst = crate::prune::WorstPicture { psnr_db: precision_db - 10.0, view: view.clone() };
            let fidelity =
                Fidelity { psnr_db: precision_db, covered_psnr_db: precision_db, worst: Some(worst) };
            misses.push((precision_db, search.record(&fidelity, precision_db as usize)));
        }
        let (precision_db, miss) = *misses.last().unwrap();
        assert!((54.0..54.3).contains(&precision_db) && miss == Some(Miss::AboveForWorst), "{misses:?}");
    }
}
