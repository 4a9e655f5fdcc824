//! The sliding fit: a capture of minutes becomes a field folder, with the memory of a few seconds.
//!
//! ```text
//! take:  a few frames from all over it -> background, which stands still
//! part:  photographs of a window
//!        background + Gaussians of the finished parts beside it + anchors where these show nothing -> Fit
//!        -> finished | for the part before | for the part after
//! end:   background and all that is finished -> segments by life -> field folder
//! ```
//!
//! A Gaussian may be alive in the photographs of the next or the previous part. If that part is not fitted yet, the
//! Gaussian is left to it, and moves there by shorter steps the more of its life is elsewhere:
//! [`Carried`](refine::fit::Carried). So parts may be fitted in any order, and by several processes, if no two beside
//! each other are fitted at once.

mod assemble;
mod background;
mod cost;
mod part;
mod past;
mod photographs;
mod plan;
mod process;
mod rows;
mod segments;
mod shown;
mod windows;
mod work_folder;

use anyhow::bail;
use codec::ClipInfo;
use program::Fault;
use refine::anchor::AnchorError;
use refine::fit::Timeline;

use super::{FitRuntime, clip_info};
use crate::capture::CaptureFiles;
use crate::fields::FitRecord;
use crate::messages::count;
use crate::takes::Shard;
pub use assemble::Assembled;
use assemble::assemble;
pub use cost::slide_cost;
use photographs::Photographs;
pub use plan::SlidePlan;
use process::Process;
pub use process::SlideProgress;
pub use segments::Segments;
use windows::Windows;
pub use work_folder::WorkFolder;

/// What a process has fitted.
#[derive(Clone, Debug)]
pub struct SlidField {
    /// The field folder; `None` while parts are missing.
    pub assembled: Option<Assembled>,
    /// Number of parts of the take.
    pub parts: usize,
    /// Number of them that are fitted.
    pub fitted: usize,
    /// Number of them that were fitted before.
    pub resumed_at: usize,
}

/// Fits parts of a take, all or the parts of a shard of `segments`, and makes the field folder if none is missing then.
///
/// # Errors
/// A [`Fault`] if a photograph or the folder cannot be read or written, another process fits one of these parts or one
/// beside them, a part beside an odd one is missing, or the device fails. What was fitted stays, and the same call goes
/// on from there.
pub fn slide(
    plan: &SlidePlan,
    capture_files: &CaptureFiles,
    mut runtime: FitRuntime,
    work: WorkFolder,
    segments: Option<(&Segments, Shard)>,
    on_progress: &mut dyn FnMut(&SlideProgress),
) -> anyhow::Result<SlidField> {
    let windows = Windows::new(capture_files.capture.duration_s(), plan.unit_s);
    let numbers = match segments {
        Some((segments, shard)) => segments.numbers(shard, windows.count)?,
        None => (0..windows.count).collect(),
    };
    let photographs = Photographs::new(capture_files, windows, plan.fit.holdout)?;
    let resumed_at = work.fitted_count(&windows);
    let needs_both = matches!(segments, Some((Segments::Odd, _)));
    let missing = missing_beside(&work, &windows, &numbers, needs_both);
    let to_fit = numbers
        .into_iter()
        .filter(|part| !work.is_fitted(*part) && missing.iter().all(|(odd, _)| odd != part));
    let mut process =
        Process { plan, photographs: &photographs, runtime: &mut runtime, work: &work, without_anchor: None };
    let apart = matches!(segments, Some((Segments::Even | Segments::Odd, _)));
    process.fit(&to_fit.collect::<Vec<_>>(), apart, on_progress)?;
    let without_anchor = process.without_anchor;
    if !missing.is_empty() {
        bail!(is_missing(&work, &missing));
    }
    let fitted = work.fitted_count(&windows);
    // The last process of several makes the field folder.
    let assembled = match fitted == windows.count && work.is_alone()? {
        true => {
            let assembled = whole(plan, &photographs, &work, without_anchor)?;
            work.remove()?;
            Some(assembled)
        }
        false => None,
    };
    Ok(SlidField { assembled, parts: windows.count, fitted, resumed_at })
}

/// The parts of `numbers` that a part beside them is missing for, if they need both, and its number.
fn missing_beside(
    work: &WorkFolder,
    windows: &Windows,
    numbers: &[usize],
    needs_both: bool,
) -> Vec<(usize, usize)> {
    let missing = |part: &usize| {
        let beside = windows.beside(*part).into_iter().flatten();
        beside.filter(|beside| !work.is_fitted(*beside)).map(|beside| (*part, beside)).next()
    };
    numbers.iter().filter(|part| needs_both && !work.is_fitted(**part)).filter_map(missing).collect()
}

fn is_missing(work: &WorkFolder, missing: &[(usize, usize)]) -> Fault {
    let (part, beside) = missing[0];
    let others = match missing.len() - 1 {
        0 => String::new(),
        others => format!(" (and {} more)", count(others, "part")),
    };
    Fault::Usage(format!(
        "{}: part {part} lies between two others, and part {beside} is not fitted{others}; fit --segments even first, and \
         then repeat this",
        work.out.display()
    ))
}

/// Makes the field folder of all parts; `without_anchor` says why one of them had no anchor.
fn whole(
    plan: &SlidePlan,
    photographs: &Photographs,
    work: &WorkFolder,
    without_anchor: Option<AnchorError>,
) -> anyhow::Result<Assembled> {
    let &Photographs { capture_files, windows, interval_s, .. } = photographs;
    let record = FitRecord {
        holdout: Some(plan.fit.holdout),
        has_mattes: capture_files.has_mattes(),
        origin: capture_files.moved_origin(),
        ..FitRecord::default()
    };
    let info = info(photographs, work)?;
    let Some(assembled) = assemble(work, &windows, interval_s, &info, record)? else {
        let why = without_anchor.map_or_else(String::new, |error| format!("no anchor: {error}; "));
        let out = work.out.display();
        bail!(Fault::Data(format!(
            "{why}no part of the take has a Gaussian; remove {out}/fit and choose another --anchor"
        )));
    };
    Ok(assembled)
}

/// Metadata of the take, with viewpoints for the background and the first part that shows anything: where playing starts.
fn info(photographs: &Photographs, work: &WorkFolder) -> Result<ClipInfo, Fault> {
    let &Photographs { capture_files, windows, interval_s, .. } = photographs;
    let timeline = |duration_s: f64| Timeline { frames: 2, intervals: duration_s / interval_s };
    let background = work.fitted_background()?.finished.to_field(timeline(windows.duration_s));
    for part in 0..windows.count {
        let [from_s, to_s] = windows.span_s(part);
        let field = work.part(part)?.finished.to_field(timeline(to_s - from_s));
        if !field.is_empty() {
            let range = [from_s, to_s].map(|second| second / windows.duration_s);
            return Ok(clip_info(capture_files, &[(&field, [0.0, 1.0]), (&background, range)], None));
        }
    }
    Ok(clip_info(capture_files, &[(&background, [0.0, 1.0])], None))
}
