//! [`Scan`]: finds the coarsest of some precisions whose package meets a target PSNR, where the PSNR jumps.
//!
//! The precisions are the same for every target, multiples of a step. They are tried in ascending order, in
//! large steps from one well below the target, then in small ones below the first that meets it. So a higher
//! target never gets a coarser precision.

/// Large steps in dB, and the number of small ones in each.
const STEP_DB: f64 = 2.0;
const PARTS: usize = 8;

/// Distances of the first precision below the target and of the last one above it, in dB. The precision at which
/// a package met a target was between 4 dB below it and 14 dB above it in all fields measured.
const START_BELOW_DB: f64 = 12.0;
const END_ABOVE_DB: f64 = 28.0;

/// Large steps after the first one.
const STEPS: usize = ((START_BELOW_DB + END_ABOVE_DB) / STEP_DB) as usize;

/// Most trials of a scan: all large steps, and the small ones below the last.
pub(super) const SCANNED: usize = 1 + STEPS + PARTS - 1;

/// A scan of precisions.
#[derive(Debug)]
pub(super) struct Scan {
    /// The first large step.
    first: usize,
    /// The large step to try, or just above the small ones to try.
    step: usize,
    /// The small step to try, once a large one has met the target.
    part: Option<usize>,
    is_done: bool,
}

impl Scan {
    pub(super) fn new(target_db: f64) -> Scan {
        let first = ((target_db - START_BELOW_DB) / STEP_DB).floor().max(0.0) as usize;
        Scan { first, step: first, part: None, is_done: false }
    }

    /// Precision in dB of the next trial; `None` at the end of the scan. The last trial that met the target
    /// is the result.
    pub(super) fn next(&self) -> Option<f64> {
        let whole = STEP_DB * self.step as f64;
        let below = self.part.map_or(0, |part| PARTS - part) as f64 / PARTS as f64;
        (!self.is_done).then_some(whole - STEP_DB * below)
    }

    /// Records whether the package of [`Scan::next`] meets the target.
    pub(super) fn record(&mut self, is_met: bool) {
        match self.part {
            // Below the coarsest precision there is none.
            None if is_met => (self.part, self.is_done) = (Some(1), self.step == self.first),
            None => {
                self.step += 1;
                self.is_done = self.step > self.first + STEPS;
            }
            Some(part) => {
                self.part = Some(part + 1);
                self.is_done = is_met || part + 1 == PARTS;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The precision found for a target, and the number of trials.
    fn scan(target_db: f64, psnr_of: impl Fn(f64) -> f64) -> (Option<f64>, usize) {
        let (mut scan, mut found, mut trials) = (Scan::new(target_db), None, 0);
        while let Some(precision_db) = scan.next() {
            let psnr_db = psnr_of(precision_db);
            scan.record(psnr_db >= target_db);
            if psnr_db >= target_db {
                found = Some(precision_db);
            }
            trials += 1;
        }
        (found, trials)
    }

    #[test]
    fn a_smooth_response_is_met_within_a_small_step() {
        for target_db in [20.0, 33.3, 50.7, 80.0] {
            let (found, _) = scan(target_db, |precision| precision - 4.0);
            let excess = found.unwrap() - 4.0 - target_db;
            assert!((0.0..0.26).contains(&excess), "{target_db}: {excess}");
        }
        assert_eq!(scan(20.0, |_| 30.0), (Some(8.0), 1));
    }

    #[test]
    fn a_higher_target_never_gets_a_coarser_precision() {
        let jumping = |precision: f64| precision + 8.0 * (precision * 12.3).sin();
        let found: Vec<f64> =
            (200..700).map(|target| scan(0.1 * f64::from(target), jumping).0.unwrap()).collect();
        assert!(found.is_sorted(), "{found:?}");
    }

    #[test]
    fn a_ceiling_ends_the_scan() {
        let (found, trials) = scan(50.0, |precision| precision.min(40.0));
        assert!(found.is_none() && trials <= SCANNED, "{trials}");
        // Met by the last of the large steps, and by none of the small ones below.
        let last = (50.0f64 - START_BELOW_DB) + STEP_DB * STEPS as f64;
        assert_eq!(scan(50.0, |precision| if precision >= last { 50.0 } else { 0.0 }), (Some(last), SCANNED));
    }
}
