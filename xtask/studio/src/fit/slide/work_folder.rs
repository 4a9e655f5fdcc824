//! [`WorkFolder`]: the folder in which a sliding fit works, so that it resumes at its step.
//!
//! ```text
//! OUT/fit/lock             held while a process fits
//! OUT/fit/part-NNNN        Gaussians that step NNNN finished
//! OUT/fit/state            the next step, and the Gaussians that it starts with
//! OUT/fit/step-NNNN.*      table, picture and checkpoint of the step
//! OUT/segment-*.ply        written last, of all parts
//! OUT/field.json           makes the folder a complete field folder
//! ```
//!
//! A step writes its part before the state, so that a process that is killed between loses nothing but the step.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

use program::{Fault, output};
use refine::fit::Parameters;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::plan::SlidePlan;
use crate::fit::stored::{Magic, store, stored};
use crate::messages::unreadable;
use crate::segments::FieldFolder;

/// First bytes of a file of a step; the last one is the version of its contents.
const MAGIC: Magic = *b"aarcstp\x01";

/// What the next step starts with.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct State {
    pub(super) plan: SlidePlan,
    /// Number of the next step.
    pub(super) next: usize,
    /// Gaussians, with times in intervals of the next step.
    pub(super) carried: Parameters<f32>,
    /// Seconds of fitting so far.
    pub(super) seconds: f64,
}

/// The folder; no other process fits in it meanwhile.
pub struct WorkFolder {
    /// The field folder.
    pub(super) out: PathBuf,
    folder: PathBuf,
    lock: File,
    /// What an earlier process left, if any.
    pub(super) state: Option<State>,
}

impl WorkFolder {
    /// Opens or makes the field folder `out` to fit with `plan`, before photographs are read.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it is a finished field folder, another process fits in it, its folder `fit` is not of a fit or
    /// was begun with another plan, or it cannot be written; [`Fault::Data`] if that is damaged.
    pub fn open(plan: &SlidePlan, out: &Path) -> Result<WorkFolder, Fault> {
        let is_finished = || match FieldFolder::is_one(out) {
            true => Err(Fault::Usage(format!(
                "{}: it is finished already; remove it, or name another --out",
                out.display()
            ))),
            false => Ok(()),
        };
        is_finished()?;
        output::make_folder(out)?;
        let folder = out.join("fit");
        let path = folder.join("lock");
        if folder.exists() && !path.exists() {
            let folder = folder.display();
            return Err(Fault::Usage(format!("{folder}: it is of no fit; move it, or name another --out")));
        }
        output::make_folder(&folder)?;
        let cannot = |error| Fault::Usage(format!("cannot write {}: {error}", path.display()));
        let lock = File::create(&path).map_err(cannot)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(Fault::Usage(format!(
                    "{}: another process fits to it; wait for that, or name another --out",
                    out.display()
                )));
            }
            Err(TryLockError::Error(error)) => return Err(cannot(error)),
        }
        // A process may have finished it since.
        is_finished()?;
        let state = state_in(&folder, plan)?;
        Ok(WorkFolder { out: out.to_owned(), folder, lock, state })
    }

    /// Path of the files of a step, without extension.
    pub(super) fn step(&self, step: usize) -> PathBuf {
        self.folder.join(format!("step-{step:04}"))
    }

    fn part_path(&self, step: usize) -> PathBuf {
        self.folder.join(format!("part-{step:04}"))
    }

    /// Gaussians that a step finished, with times in intervals of that step.
    ///
    /// # Errors
    /// [`Fault::Data`] if the file is missing or damaged.
    pub(super) fn part(&self, step: usize) -> Result<Parameters<f32>, Fault> {
        read(&self.part_path(step))
    }

    /// Writes what a step finished, and then the state.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written.
    pub(super) fn complete(
        &self,
        step: usize,
        finished: &Parameters<f32>,
        state: &State,
    ) -> anyhow::Result<()> {
        store(&self.part_path(step), MAGIC, finished)?;
        self.write_state(state)?;
        Ok(crate::fit::remove_checkpoint(&self.step(step))?)
    }

    /// Writes what the next step starts with.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written.
    pub(super) fn write_state(&self, state: &State) -> anyhow::Result<()> {
        store(&self.folder.join("state"), MAGIC, state)
    }

    /// Removes what only fitting needed; other files in its folder stay.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be removed.
    pub(super) fn remove(self) -> Result<(), Fault> {
        let WorkFolder { folder, lock, .. } = self;
        let cannot = |error| Fault::Usage(format!("cannot remove {}: {error}", folder.display()));
        let mut is_empty = true;
        for entry in fs::read_dir(&folder).map_err(cannot)? {
            let entry = entry.map_err(cannot)?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            match ["part-", "step-", "state", "lock"].iter().any(|own| name.starts_with(own)) {
                true => fs::remove_file(entry.path()).map_err(cannot)?,
                false => is_empty = false,
            }
        }
        if is_empty {
            fs::remove_dir(&folder).map_err(cannot)?;
        }
        drop(lock);
        Ok(())
    }
}

/// The state that an earlier process left, if any.
///
/// # Errors
/// [`Fault::Data`] if it is damaged, [`Fault::Usage`] if it has another plan.
fn state_in(folder: &Path, plan: &SlidePlan) -> Result<Option<State>, Fault> {
    let path = folder.join("state");
    if !path.exists() {
        return Ok(None);
    }
    let state: State = read(&path)?;
    match state.plan == *plan {
        true => Ok(Some(state)),
        false => Err(Fault::Usage(format!(
            "{}: a fit of another capture or with other options was begun there; repeat these, remove it, or name \
             another --out",
            folder.display()
        ))),
    }
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Fault> {
    let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
    stored(MAGIC, &bytes).map_err(|_| {
        Fault::Data(format!(
            "{}: damaged, or of another version; remove its folder to fit anew",
            path.display()
        ))
    })
}
