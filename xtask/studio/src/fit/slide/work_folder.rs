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
use crate::fit::plan::crc;
use crate::messages::unreadable;
use crate::segments::FieldFolder;

/// First bytes of a file of a step; the last one is the version of its contents.
const MAGIC: [u8; 8] = *b"aarcstp\x01";

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
pub(super) struct WorkFolder {
    folder: PathBuf,
    _lock: File,
}

impl WorkFolder {
    /// Opens or makes the folder `out`.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it is a finished field folder, another process fits in it, or it cannot be written.
    pub(super) fn open(out: &Path) -> Result<WorkFolder, Fault> {
        if FieldFolder::is_one(out) {
            let out = out.display();
            return Err(Fault::Usage(format!(
                "{out}: it is finished already; remove it, or name another --out"
            )));
        }
        output::make_folder(out)?;
        let folder = out.join("fit");
        output::make_folder(&folder)?;
        let path = folder.join("lock");
        let cannot = |error| Fault::Usage(format!("cannot write {}: {error}", path.display()));
        let lock = File::create(&path).map_err(cannot)?;
        match lock.try_lock() {
            Ok(()) => Ok(WorkFolder { folder, _lock: lock }),
            Err(TryLockError::WouldBlock) => Err(Fault::Usage(format!(
                "{}: another process fits to it; wait for that, or name another --out",
                out.display()
            ))),
            Err(TryLockError::Error(error)) => Err(cannot(error)),
        }
    }

    /// The state that an earlier process left, if any.
    ///
    /// # Errors
    /// [`Fault::Data`] if it is damaged, [`Fault::Usage`] if it has another plan.
    pub(super) fn state(&self, plan: &SlidePlan) -> Result<Option<State>, Fault> {
        let path = self.folder.join("state");
        if !path.exists() {
            return Ok(None);
        }
        let state: State = read(&path)?;
        match state.plan == *plan {
            true => Ok(Some(state)),
            false => Err(Fault::Usage(format!(
                "{}: a fit of another capture or with other options was begun there; repeat these, remove it, or name \
                 another --out",
                self.folder.display()
            ))),
        }
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
        write(&self.part_path(step), finished)?;
        write(&self.folder.join("state"), state)?;
        Ok(crate::fit::remove_checkpoint(&self.step(step))?)
    }

    /// Removes what only fitting needed.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be removed.
    pub(super) fn remove(self) -> Result<(), Fault> {
        let WorkFolder { folder, _lock: lock } = self;
        drop(lock);
        fs::remove_dir_all(&folder)
            .map_err(|error| Fault::Usage(format!("cannot remove {}: {error}", folder.display())))
    }
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Fault> {
    let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
    let damaged = || {
        Fault::Data(format!(
            "{}: damaged, or of another version; remove its folder to fit anew",
            path.display()
        ))
    };
    let body = bytes.strip_prefix(&MAGIC).ok_or_else(damaged)?;
    let (checksum, body) = body.split_first_chunk().ok_or_else(damaged)?;
    if u32::from_le_bytes(*checksum) != crc(body) {
        return Err(damaged());
    }
    postcard::from_bytes(body).map_err(|_| damaged())
}

fn write(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let body = postcard::to_stdvec(value)?;
    let bytes = [&MAGIC[..], &crc(&body).to_le_bytes(), &body].concat();
    Ok(output::write_durable(path, &bytes)?)
}
