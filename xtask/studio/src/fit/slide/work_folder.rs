//! [`WorkFolder`]: the folder in which the parts of a take are fitted, by one process or by several.
//!
//! ```text
//! OUT/fit/lock              held while a process is at work here: alone, or with others that fit other parts
//! OUT/fit/plan              the settings, which all of them share
//! OUT/fit/background        Gaussians that are always on; .lock is held while they are fitted
//! OUT/fit/part-NNNN         what the fit of part NNNN left
//! OUT/fit/part-NNNN.lock    held while it is fitted; says between which finished parts
//! OUT/fit/part-NNNN.*       table, picture and checkpoint of this fit
//! OUT/segment-*.ply         written last, of all parts
//! OUT/field.json            makes the folder a complete field folder
//! ```

use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use program::{Fault, output};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::part::{Beside, FittedPart, is_finished};
use super::plan::SlidePlan;
use super::windows::Windows;
use crate::capture::CaptureFiles;
use crate::fit::remove_checkpoint;
use crate::fit::stored::{Magic, store, stored};
use crate::fit::training_views::evenly;
use crate::messages::unreadable;
use crate::segments::FieldFolder;

/// First bytes of a file; the last one is the version of its contents.
const MAGIC: Magic = *b"aarcstp\x05";

/// How often, and how long in between, a process tries for the lock that another one holds for a moment.
const TRIES: u32 = 20;
const TRY_EVERY: Duration = Duration::from_millis(50);

/// The folder, locked.
pub struct WorkFolder {
    /// The field folder.
    pub(super) out: PathBuf,
    folder: PathBuf,
    lock: File,
}

/// A part that this process fits, and no other one meanwhile.
pub(super) struct Claim {
    pub(super) part: usize,
    /// The finished parts beside it.
    pub(super) beside: Beside,
    /// Path of the files of the fit, without extension.
    pub(super) out: PathBuf,
    _lock: File,
}

impl WorkFolder {
    /// Opens or makes the field folder `out` to fit with `plan`, before photographs are read; with other processes that
    /// share it, or alone.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it is a finished field folder, another process fits in it, its folder `fit` is not of a fit or
    /// was begun with another plan, or it cannot be written; [`Fault::Data`] if that is damaged.
    pub fn open(
        plan: &SlidePlan,
        capture_files: &CaptureFiles,
        out: &Path,
        is_shared: bool,
    ) -> Result<WorkFolder, Fault> {
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
        let has_files = fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some());
        if has_files && !path.exists() {
            let folder = folder.display();
            return Err(Fault::Usage(format!("{folder}: it is of no fit; move it, or name another --out")));
        }
        output::make_folder(&folder)?;
        let work = WorkFolder { out: out.to_owned(), lock: lock_file(&path)?, folder };
        let path = work.folder.join("plan");
        let sizes = sizes(capture_files);
        let is_alone = work.is_locked_alone()?;
        // The first process writes the plan while it is alone.
        if is_alone && !path.exists() {
            let begun = Begun { plan: plan.clone(), sizes: sizes.clone() };
            store(&path, MAGIC, &begun).map_err(|error| Fault::Usage(error.to_string()))?;
        }
        let is_locked = if is_shared { work.is_locked_with_others()? } else { is_alone };
        if !is_locked {
            return Err(work.is_busy());
        }
        // A process may have finished it since.
        is_finished()?;
        let begun: Begun = read(&path)?;
        let what = match begun.plan == *plan {
            true if is_alike(&begun.sizes, &sizes) => return Ok(work),
            true => "a fit of other photographs",
            false => {
                "a fit of another capture, or of one with more or fewer photographs, or with other options"
            }
        };
        Err(Fault::Usage(format!(
            "{}: {what} was begun there; repeat these, remove it, or name another --out",
            work.folder.display()
        )))
    }

    /// Removes what a process left that was killed after it had completed the field folder `out`.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be removed.
    pub fn tidy(out: &Path) -> Result<(), Fault> {
        let folder = out.join("fit");
        let path = folder.join("lock");
        if !FieldFolder::is_one(out) || !path.exists() {
            return Ok(());
        }
        let work = WorkFolder { out: out.to_owned(), lock: lock_file(&path)?, folder };
        if work.is_locked_alone()? { work.remove() } else { Ok(()) }
    }

    fn cannot_lock(&self, error: &dyn std::fmt::Display) -> Fault {
        Fault::Usage(format!("cannot lock {}: {error}", self.folder.join("lock").display()))
    }

    fn is_busy(&self) -> Fault {
        let out = self.out.display();
        Fault::Usage(format!("{out}: another process fits to it; wait for that, or name another --out"))
    }

    fn is_locked_alone(&self) -> Result<bool, Fault> {
        is_locked(self.lock.try_lock()).map_err(|error| self.cannot_lock(&error))
    }

    fn is_locked_with_others(&self) -> Result<bool, Fault> {
        for _ in 0..TRIES {
            if is_locked(self.lock.try_lock_shared()).map_err(|error| self.cannot_lock(&error))? {
                return Ok(true);
            }
            thread::sleep(TRY_EVERY);
        }
        Ok(false)
    }

    /// Whether no other process is at work here, nor has completed the field folder; none can begin then.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the folder cannot be locked.
    pub(super) fn is_alone(&self) -> Result<bool, Fault> {
        // Two processes that both hold it would both fail to hold it alone.
        self.lock.unlock().map_err(|error| self.cannot_lock(&error))?;
        Ok(self.is_locked_alone()? && !FieldFolder::is_one(&self.out))
    }

    fn part_path(&self, part: usize) -> PathBuf {
        self.folder.join(format!("part-{part:04}"))
    }

    /// Whether a part is fitted.
    pub(super) fn is_fitted(&self, part: usize) -> bool {
        self.part_path(part).exists()
    }

    /// Number of parts that are fitted.
    pub(super) fn fitted_count(&self, windows: &Windows) -> usize {
        (0..windows.count).filter(|part| self.is_fitted(*part)).count()
    }

    /// What the fit of a part left.
    ///
    /// # Errors
    /// [`Fault::Data`] if the file is missing or damaged.
    pub(super) fn part(&self, part: usize) -> Result<FittedPart, Fault> {
        read(&self.part_path(part))
    }

    /// The background, which `make` fits if no process has; waits while another one does. `make` takes the path of the
    /// files of its fit, without extension.
    ///
    /// # Errors
    /// Those of `make`; [`Fault::Data`] if the file is damaged, and [`Fault::Usage`] if it cannot be written.
    pub(super) fn background(
        &self,
        make: impl FnOnce(&Path) -> anyhow::Result<FittedPart>,
    ) -> anyhow::Result<FittedPart> {
        let path = self.folder.join("background");
        let lock = lock_file(&self.folder.join("background.lock"))?;
        lock.lock().map_err(|error| self.cannot_lock(&error))?;
        if path.exists() {
            return Ok(read(&path)?);
        }
        let background = make(&path)?;
        store(&path, MAGIC, &background)?;
        remove_checkpoint(&path)?;
        Ok(background)
    }

    /// The background that some process fitted.
    ///
    /// # Errors
    /// [`Fault::Data`] if the file is missing or damaged.
    pub(super) fn fitted_background(&self) -> Result<FittedPart, Fault> {
        read(&self.folder.join("background"))
    }

    /// Claims a part; `None` if it is fitted already.
    ///
    /// # Errors
    /// [`Fault::Usage`] if another process fits it, or one beside it; [`Fault::Data`] if a part beside it is damaged.
    pub(super) fn claim(&self, part: usize, windows: &Windows) -> Result<Option<Claim>, Fault> {
        let out = self.part_path(part);
        let lock_path = |part: usize| self.part_path(part).with_extension("lock");
        let path = lock_path(part);
        let mut lock = lock_file(&path)?;
        let busy = |part: usize| {
            Fault::Usage(format!("{}: another process fits part {part}; wait for that", self.out.display()))
        };
        if !is_locked(lock.try_lock()).map_err(|error| self.cannot_lock(&error))? {
            return Err(busy(part));
        }
        // Another process may have fitted it since.
        if self.is_fitted(part) {
            return Ok(None);
        }
        let mut beside = Beside::default();
        for (fitted, number) in beside.iter_mut().zip(windows.beside(part)) {
            let Some(number) = number else { continue };
            // First whether it is being fitted: it may be finished by then.
            if lock_path(number).exists() {
                let theirs = lock_file(&lock_path(number))?;
                if !is_locked(theirs.try_lock_shared()).map_err(|error| self.cannot_lock(&error))?
                    && !self.is_fitted(number)
                {
                    return Err(busy(number));
                }
            }
            if self.is_fitted(number) {
                *fitted = Some(self.part(number)?);
            }
        }
        // A part that was begun between others begins anew.
        let between = is_finished(&beside).map(u8::from);
        let mut begun = Vec::new();
        let cannot = |error| Fault::Usage(format!("cannot write {}: {error}", path.display()));
        lock.read_to_end(&mut begun).map_err(cannot)?;
        if begun != between {
            remove_checkpoint(&out)?;
            let write = |lock: &mut File| {
                lock.rewind()?;
                lock.set_len(0)?;
                lock.write_all(&between)?;
                lock.sync_all()
            };
            write(&mut lock).map_err(cannot)?;
        }
        Ok(Some(Claim { part, beside, out, _lock: lock }))
    }

    /// Writes what the fit of a part left.
    ///
    /// # Errors
    /// [`Fault::Usage`] if it cannot be written.
    pub(super) fn complete(&self, claim: Claim, fitted: &FittedPart) -> anyhow::Result<()> {
        store(&self.part_path(claim.part), MAGIC, fitted)?;
        Ok(remove_checkpoint(&claim.out)?)
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
            match is_own(&name.to_string_lossy()) && entry.path().is_file() {
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

/// Whether a file in the folder has a name that a fit gives one.
fn is_own(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or(name);
    let is_part = || stem.strip_prefix("part-").is_some_and(|number| number.parse::<usize>().is_ok());
    ["plan", "lock"].contains(&name) || stem == "background" || is_part() || output::is_unfinished(name)
}

/// What a fit was begun with.
#[derive(Serialize, Deserialize)]
struct Begun {
    plan: SlidePlan,
    /// Sizes in bytes of a few photographs.
    sizes: Vec<u64>,
}

/// Number of photographs whose sizes tell a capture from others of the same rig.
const SIZED: usize = 32;

/// Sizes in bytes of a few photographs, evenly over the take; 0 of one that is missing.
fn sizes(capture_files: &CaptureFiles) -> Vec<u64> {
    let size = |photo_id| fs::metadata(capture_files.path(photo_id)).map_or(0, |file| file.len());
    evenly(&capture_files.capture.photos, SIZED).into_iter().map(size).collect()
}

/// Whether most of the sizes are the same: a damaged photograph may have been repaired since.
fn is_alike(a: &[u64], b: &[u64]) -> bool {
    2 * a.iter().zip(b).filter(|(a, b)| a == b).count() >= a.len().max(b.len())
}

/// Opens a file to lock, which need not exist.
fn lock_file(path: &Path) -> Result<File, Fault> {
    let open = File::options().read(true).write(true).create(true).truncate(false).open(path);
    open.map_err(|error| Fault::Usage(format!("cannot write {}: {error}", path.display())))
}

/// Whether it is locked; not if another process holds it.
fn is_locked(tried: Result<(), TryLockError>) -> std::io::Result<bool> {
    match tried {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Fault> {
    let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
    let is_part = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("part-"));
    let cure = if is_part { "remove it to fit that part anew" } else { "remove its folder to fit anew" };
    stored(MAGIC, &bytes)
        .map_err(|_| Fault::Data(format!("{}: damaged, or of another version; {cure}", path.display())))
}
