//! Sequences: a folder of static fields, one a frame, becomes one moving field, and a moving field such a folder.
//!
//! Where the rows are the same Gaussians in every frame, trajectories and windows are fitted to them. Where they are not,
//! every frame keeps its own Gaussians, in a window of that frame. A note says which, how far off the fit is, or what the
//! windows cost. The frames are read one after another: the first way holds 56 bytes a row and frame.

mod alone;
mod files;
mod fitted;
mod frames;
mod lost;
mod polynomial;
mod reading;
mod rows;
mod samples;
mod track;
mod window;

use std::path::Path;

use codec::Field;

use crate::account::{Account, Repairs};
use crate::clean::clean;
use crate::error::ImportError;
use crate::imported::{Hints, Imported};
use crate::limits::{ImportBudget, ImportLimits};

use alone::FramesAlone;
use fitted::{FitError, TOLERANCE, fitted};
use reading::{Apart, Frame, Sequence, Unusable, read_frame};

pub use files::SequenceFiles;
pub(crate) use files::last_stage;
pub use frames::SequenceFrames;

/// Frames whose Gaussians are alive at an instant where every frame has its own.
const ALIVE_FRAMES: usize = 3;

/// Reads a sequence of static fields as one moving field.
///
/// Missing and empty frames are filled from their neighbours, and a note says so.
///
/// # Errors
/// [`ImportError`] that names the frame or the folder: a frame that cannot be imported, that moves, or that is drawn
/// with another filter than the first; more than half of the frames missing; no Gaussian in any; beyond `limits`.
pub fn import_sequence(files: &SequenceFiles, limits: ImportLimits) -> Result<Imported, ImportError> {
    let folder = files.frames.first().and_then(|(_, path)| path.parent()).unwrap_or(Path::new("."));
    let mut budget = ImportBudget::new(limits);
    let sequence = Sequence::read(files, limits, &mut budget)?;
    let notes = sequence.notes(files);
    let about = |what: String| ImportError::new(folder, what);
    let hints = hints(&sequence.hints, files.steps());
    let Account { mut repairs, mut assumed, lost } = sequence.account;
    assumed.extend(notes);
    let (field, format, note) = match sequence.apart {
        None => {
            let (frames, rows) = (sequence.frames.frames.len(), sequence.frames.frames[0].len());
            let (field, error) = fitted(&sequence.frames, &mut budget).map_err(about)?;
            let note = note_of_fit(frames, rows, field.len(), &error);
            (field, "sequence with corresponding rows", note)
        }
        Some(apart) => {
            drop(sequence.frames);
            let field;
            (field, repairs) = join_frames(files, limits)?;
            let note = note_of_frames(&apart, field.len(), files.frames.len());
            (field, "sequence", note)
        }
    };
    assumed.push(note);
    let field = clean(field, &mut repairs);
    let account = Account { repairs, assumed, lost };
    let imported = Imported { field, hints, format, account };
    match imported.field.is_empty() {
        false => Ok(imported.with_near()),
        true => Err(about(imported.no_gaussians())),
    }
}

/// The metadata of the clip: the first frame's, and the duration from the number of frames.
fn hints(first: &Hints, steps: usize) -> Hints {
    let duration_s = first.fps.map(|fps| (steps - 1) as f32 / fps);
    Hints { duration_s, frames: Some(steps), comments: Vec::new(), ..first.clone() }
}

/// The Gaussians of all frames, each in a window of its frame, and what was repaired.
fn join_frames(files: &SequenceFiles, limits: ImportLimits) -> Result<(Field, Repairs), ImportError> {
    // What was read before is gone.
    let mut budget = ImportBudget::new(limits);
    let mut joined = FramesAlone::new(files.steps());
    let mut repairs = Repairs::default();
    let (mut origin, mut waiting): (_, Option<Frame>) = (None, None);
    for (step, path) in &files.frames {
        let frame = read_frame(path, *step, limits, Unusable::Dropped, &mut origin)?;
        repairs.add(&frame.account.repairs);
        if frame.is_empty() {
            continue;
        }
        if let Some(before) = waiting.replace(frame) {
            let shown = step - before.step;
            let error = |what: String| ImportError::new(path, what);
            joined.push(&before.field, before.step, shown, &mut budget).map_err(error)?;
        }
    }
    if let Some(last) = waiting {
        let error = |what: String| ImportError::new(&last.path, what);
        joined.push(&last.field, last.step, files.steps() - last.step, &mut budget).map_err(error)?;
    }
    Ok((joined.into_field(), repairs))
}

fn note_of_fit(frames: usize, rows: usize, gaussians: usize, error: &FitError) -> String {
    let relative = |distance: f64| 100.0 * distance / error.size;
    let mut note = format!(
        "{frames} frames with {rows} corresponding rows became {gaussians} Gaussians on cubic trajectories; positions \
         are off by {:.2e} units rms and {:.2e} at most ({:.3} % and {:.3} % of the size), opacities by {:.3} rms",
        error.position_rms(),
        error.position_max,
        relative(error.position_rms()),
        relative(error.position_max),
        error.opacity_rms()
    );
    if error.rough > 0 {
        let rough = error.rough;
        note += &format!(
            "; {rough} rows stay off by more than the tolerance of {} %: they jitter, or move too fast for the frames, and \
             more Gaussians would gain little",
            100.0 * TOLERANCE
        );
    }
    if error.invisible > 0 {
        note += &format!("; {} rows are invisible in all frames and left out", error.invisible);
    }
    note
}

fn note_of_frames(apart: &Apart, gaussians: usize, frames: usize) -> String {
    let Apart { reason, first_rows } = apart;
    let times = gaussians as f64 / (*first_rows).max(1) as f64;
    format!(
        "{reason}, so every frame keeps its own Gaussians, in a window of that frame: {gaussians} in {frames} frames, \
         {times:.0} times those of one; about {ALIVE_FRAMES} frames are drawn at an instant, and between two frames \
         they fade into each other instead of moving"
    )
}
