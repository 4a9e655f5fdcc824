//! [`Checkpoint`]: the saved state of a fit, from which it resumes with the same result.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use program::{Fault, output};
use refine::fit::Fit;
use serde::{Deserialize, Serialize};

use super::log::{Density, LogEntry, beside};
use super::plan::{FitPlan, crc};

/// First bytes of a checkpoint; the last one is the version of its contents.
const MAGIC: [u8; 8] = *b"aarcfit\x05";

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
        let body = bytes.strip_prefix(&MAGIC).ok_or_else(|| bad("no checkpoint of this version".into()))?;
        let damaged = || bad("the checkpoint is damaged".into());
        let (checksum, body) = body.split_first_chunk().ok_or_else(damaged)?;
        if u32::from_le_bytes(*checksum) != crc(body) {
            return Err(damaged());
        }
        let checkpoint: Checkpoint = postcard::from_bytes(body).map_err(|_| damaged())?;
        if !checkpoint.fit.is_consistent() || checkpoint.fit.is_done() {
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

    /// Writes the checkpoint to `path`, whole or not at all, and durably.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the path.
    pub(super) fn save(&self, path: &Path) -> anyhow::Result<()> {
        let body = postcard::to_stdvec(self)?;
        let bytes = [&MAGIC[..], &crc(&body).to_le_bytes(), &body].concat();
        Ok(output::write_durable(path, &bytes)?)
    }
}
