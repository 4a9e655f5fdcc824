//! [`Sequence`]: the frames of a sequence, read one after another as far as their rows correspond.

use std::path::{Path, PathBuf};

use codec::{Field, sh_coefficients};

use crate::account::Account;
use crate::columns::padded_sh;
use crate::error::ImportError;
use crate::imported::{Hints, Imported};
use crate::limits::{ImportBudget, ImportLimits};
use crate::source::FieldSource;

use super::files::SequenceFiles;
use super::fitted::{Frames, size_of};
use super::rows::correspond;

/// Bytes of a row in a frame without view-dependent colour.
const BYTES_PER_ROW: u64 = 56;

/// Most bytes of a row that cannot be used: the bytes of an entry of its own.
const BYTES_PER_LOST_ROW: u64 = 64;

/// A static field and its place in the sequence. It may have no rows.
pub(super) struct Frame {
    pub(super) field: Field,
    pub(super) step: usize,
    pub(super) path: PathBuf,
    hints: Hints,
    pub(super) account: Account,
    /// Rows that cannot be used, ascending, if they were not left out.
    lost: Vec<usize>,
}

impl Frame {
    /// Whether there is nothing to draw.
    pub(super) fn is_empty(&self) -> bool {
        self.lost.len() == self.field.len()
    }
}

/// What becomes of rows that cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unusable {
    /// They are left out.
    Dropped,
    /// They keep their places and are listed.
    Listed,
}

/// Why the rows of a sequence do not correspond.
pub(super) struct Apart {
    /// The beginning of a sentence that names two frames.
    pub(super) reason: String,
    /// Rows of the first frame.
    pub(super) first_rows: usize,
}

/// What was read of a sequence.
pub(super) struct Sequence {
    /// All frames that are not empty; those up to the first that differs, if `apart` says why.
    pub(super) frames: Frames,
    /// Why the rows do not correspond.
    pub(super) apart: Option<Apart>,
    /// The metadata in the first frame.
    pub(super) hints: Hints,
    /// The repairs of all frames, and what the first one leaves open or loses: the others are alike.
    pub(super) account: Account,
    empty: usize,
}

/// Reads a frame, about the `origin` of the frames before it, which the first one with Gaussians sets.
///
/// # Errors
/// [`ImportError`] that names the frame, which cannot be imported or moves.
pub(super) fn read_frame(
    path: &Path,
    step: usize,
    limits: ImportLimits,
    unusable: Unusable,
    origin: &mut Option<[f64; 3]>,
) -> Result<Frame, ImportError> {
    let mut budget = ImportBudget::new(limits);
    let source = FieldSource::open(path, &mut budget)?;
    let (mut imported, lost) = match unusable {
        Unusable::Dropped => (source.read_clean(path, &mut budget)?, Vec::new()),
        Unusable::Listed => source.read_in_place(path, &mut budget)?,
    };
    if imported.field.temporal.is_some() {
        let what = "this frame moves or fades by itself; a sequence has static frames, `export --sequence` writes such";
        return Err(ImportError::new(path, what));
    }
    if !imported.field.is_empty() {
        imported.move_origin(*origin.get_or_insert(imported.hints.origin.unwrap_or_default()));
    }
    let Imported { field, hints, account, .. } = imported;
    Ok(Frame { field, step, path: path.to_owned(), hints, account, lost })
}

impl Sequence {
    /// Reads the frames.
    ///
    /// # Errors
    /// As [`super::import_sequence`] has them.
    pub(super) fn read(
        files: &SequenceFiles,
        limits: ImportLimits,
        budget: &mut ImportBudget,
    ) -> Result<Sequence, ImportError> {
        let steps = files.steps();
        let (_, first) = &files.frames[0];
        if 2 * files.frames.len() < steps {
            let (found, folder) = (files.frames.len(), first.parent().unwrap_or(Path::new(".")));
            let what = format!(
                "{found} of {steps} frames are there by their numbers; add the missing ones, or renumber"
            );
            return Err(ImportError::new(folder, what));
        }
        let frames = Frames { steps, ..Frames::default() };
        let (hints, account) = (Hints::default(), Account::default());
        let mut sequence = Sequence { frames, apart: None, hints, account, empty: 0 };
        let mut origin = None;
        let mut before: Option<Frame> = None;
        let mut size = None;
        for (step, path) in &files.frames {
            let frame = read_frame(path, *step, limits, Unusable::Listed, &mut origin)?;
            sequence.account.repairs.add(&frame.account.repairs);
            if frame.is_empty() {
                sequence.empty += 1;
                continue;
            }
            match &before {
                Some(before) => check_filter(before, &frame)?,
                None => {
                    let Account { assumed, lost, .. } = frame.account.clone();
                    let repairs = std::mem::take(&mut sequence.account.repairs);
                    (sequence.hints, sequence.account) =
                        (frame.hints.clone(), Account { repairs, assumed, lost });
                }
            }
            // The rest is read for its repairs and errors.
            if sequence.apart.is_none() {
                sequence.apart = before.as_ref().and_then(|before| {
                    let size = *size.get_or_insert_with(|| size_of(&before.field));
                    sequence.difference(before, &frame, size)
                });
                if sequence.apart.is_none() {
                    sequence.add(&frame, budget).map_err(|what| ImportError::new(path, what))?;
                }
            }
            before = Some(frame);
        }
        if before.is_none() {
            return Err(ImportError::new(
                first,
                "neither this frame nor a later one has Gaussians; export them again",
            ));
        }
        let Frames { times, frames, lost, .. } = &mut sequence.frames;
        let filled = lost.fill(times, frames);
        sequence.account.repairs.repair_rows("not usable in a frame, filled from those beside", filled);
        Ok(sequence)
    }

    /// Why the rows of a frame, whose content has this `size`, differ from the rows of the frame before.
    fn difference(&self, before: &Frame, frame: &Frame, size: f64) -> Option<Apart> {
        let [a, b] = [before, frame].map(|frame| frame.path.file_name().unwrap_or_default().display());
        let (rows_a, rows_b) = (before.field.len(), frame.field.len());
        let is_lost = |row: usize| [before, frame].iter().any(|frame| frame.lost.binary_search(&row).is_ok());
        let reason = if rows_a != rows_b {
            format!("{a} has {rows_a} rows and {b} has {rows_b}")
        } else if correspond(&before.field, &frame.field, size, is_lost) {
            return None;
        } else {
            format!("{b} has other Gaussians in its rows than {a}")
        };
        let first_rows = self.frames.frames.first().map_or(0, Field::len);
        Some(Apart { reason, first_rows })
    }

    /// Adds a frame with the rows of the frames before.
    fn add(&mut self, frame: &Frame, budget: &mut ImportBudget) -> Result<(), String> {
        let field = &frame.field;
        budget.spend(field.len() as u64 * BYTES_PER_ROW + frame.lost.len() as u64 * BYTES_PER_LOST_ROW)?;
        let Frames { times, frames, steps, sh_degree, sh_sums, lost } = &mut self.frames;
        lost.add(frames.len(), &frame.lost);
        let degree = field.sh_degree.max(*sh_degree);
        if frames.is_empty() {
            budget.spend(12 * field.sh.len() as u64)?;
        } else if degree > *sh_degree {
            budget.spend(12 * (field.len() * sh_coefficients(degree)) as u64)?;
        }
        let added = padded_sh(&field.sh, field.sh_degree, degree);
        *sh_sums = match frames.is_empty() {
            true => added,
            false => {
                let mut sums = padded_sh(sh_sums, *sh_degree, degree);
                for (sum, added) in sums.as_flattened_mut().iter_mut().zip(added.as_flattened()) {
                    *sum += added;
                }
                sums
            }
        };
        *sh_degree = degree;
        times.push(frame.step as f64 / (*steps - 1) as f64);
        let sh = field.sh.iter().step_by(sh_coefficients(field.sh_degree)).copied().collect();
        frames.push(Field {
            centers: field.centers.clone(),
            rotations: field.rotations.clone(),
            log_scales: field.log_scales.clone(),
            opacities: field.opacities.clone(),
            sh_degree: 0,
            sh,
            filter: field.filter,
            near: field.near,
            temporal: None,
        });
        Ok(())
    }

    /// What was repaired: missing and empty frames.
    pub(super) fn notes(&self, files: &SequenceFiles) -> Vec<String> {
        let missing = files.missing().map(|frames| {
            format!("{frames} missing; the frames beside are shown in that time, or the motion goes on")
        });
        let empty =
            (self.empty > 0).then(|| format!("{} frames without Gaussians count as missing", self.empty));
        missing.into_iter().chain(empty).collect()
    }
}

fn check_filter(before: &Frame, frame: &Frame) -> Result<(), ImportError> {
    let [a, b] = [before, frame].map(|frame| frame.field.filter.name());
    if a == b {
        return Ok(());
    }
    let what = format!(
        "this frame is drawn with the filter {b}, and {} with {a}; export all frames alike",
        before.path.file_name().unwrap_or_default().display()
    );
    Err(ImportError::new(&frame.path, what))
}
