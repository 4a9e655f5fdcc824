//! [`Checkpoint`]: the saved state of a fit, from which it resumes with the same result.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use program::Fault;
use refine::fit::Fit;
use serde::{Deserialize, Serialize};

use super::log::{Density, LogEntry};
use super::plan::FitPlan;
use super::stored::{Magic, Unstored, store, stored};
use crate::scene::beside;

/// First bytes of a checkpoint; the last one is the version of its contents.
const MAGIC: Magic = *b"aarcfit\x0d";

/// A fit and its plan.
#[derive(Serialize, Deserialize)]
pub(super) struct Checkpoint {
    pub(super) plan: FitPlan,
    pub(super) fit: Fit,
    /// Seconds of fitting so far.
    pub(super) seconds: f64,
    /// The lines of the table so far.
    pub(super) entries: Vec<LogEntry>,
    /// Sums for the next line of the table.
    pub(super) tally: Tally,
}

/// Sums over the steps since the last line of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tally {
    pub(super) loss: f64,
    pub(super) drawn: usize,
    pub(super) density: Density,
    pub(super) steps: u32,
}

/// Path of the checkpoint of a field, beside the field.
pub(super) fn path_for(field: &Path) -> PathBuf {
    beside(field, "checkpoint")
}

impl Checkpoint {
    /// The checkpoint at `path`, `None` if there is no file.
    ///
    /// # Errors
    /// [`Fault::Data`] if the file cannot be read or is no checkpoint, [`Fault::Usage`] if its plan is not `plan`.
    pub(super) fn load(path: &Path, plan: &FitPlan) -> Result<Option<Checkpoint>, Fault> {
        let bad = |what: String| {
            Fault::Data(format!("{}: {what}; remove it to start from the beginning", path.display()))
        };
        let bytes = match std::fs::read(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            read => read.map_err(|error| bad(error.to_string()))?,
        };
        let damaged = || bad("the checkpoint is damaged".into());
        let checkpoint: Checkpoint = stored(MAGIC, &bytes).map_err(|why| match why {
            Unstored::Version => bad("no checkpoint of this version".into()),
            Unstored::Damaged => damaged(),
        })?;
        if !checkpoint.fit.is_consistent() {
            return Err(damaged());
        }
        match checkpoint.plan == *plan {
            true => Ok(Some(checkpoint)),
            false => Err(Fault::Usage(format!(
                "{} is of a fit with other options: repeat them, remove it, or name another --out",
                path.display()
            ))),
        }
    }

    /// The checkpoint of a fit after its last step.
    pub(super) fn of_finished(plan: &FitPlan, fit: &Fit, entries: &[LogEntry]) -> Checkpoint {
        Checkpoint {
            plan: plan.clone(),
            fit: fit.clone(),
            seconds: entries.last().map_or(0.0, |entry| entry.seconds),
            entries: entries.to_vec(),
            tally: Tally::default(),
        }
    }

    /// Writes the checkpoint to `path`, whole or not at all, and durably.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the path.
    pub(super) fn save(&self, path: &Path) -> anyhow::Result<()> {
        store(path, MAGIC, self)
    }
}
