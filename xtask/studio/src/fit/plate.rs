//! [`fit_plate`]: the static field of the background, fitted to the plates of the cameras.
//!
//! Plates show one instant that lasts, so this is a fit to a capture of one frame, which needs no masks.

use std::path::Path;

use program::Fault;
use refine::anchor::Mirror;
use refine::capture::{Holdout, PhotoId};
use refine::fit::{Learned, Photograph, Timeline, TrainingView};

use super::checkpoint::{self, Checkpoint};
use super::plan::{Coarse, FitPlan, FitStart, default_gaussians};
use super::strangers::name_strangers;
use super::training_views::{TrainingViews, responses};
use super::{FitProgress, FitRuntime, Fitted, fit};
use crate::capture::CaptureFiles;
use crate::scene::plate_path;

/// A plate gets as many Gaussians as a subject in so many frames: a room is larger than who is in it, and does not move.
const FRAMES: usize = 4;

/// Fits a static field to the plates of the cameras that are not held out. `out` is the path of the field that belongs in
/// front of it; the caller writes the plate. It gets no more steps and Gaussians than `plan` has. What it learns of the cameras' colours is what
/// the other fit starts from.
///
/// # Errors
/// Those of [`fit`]; [`Fault::Data`] if a plate cannot be read, [`Fault::Usage`] if its checkpoint cannot be written.
pub fn fit_plate(
    plan: &FitPlan,
    capture_files: &CaptureFiles,
    runtime: FitRuntime,
    out: &Path,
    on_progress: &mut dyn FnMut(&FitProgress),
) -> anyhow::Result<Fitted> {
    let gaussians = default_gaussians(FRAMES, capture_files).min(plan.gaussians);
    let steps = plan.plate_steps();
    let small = plan.start_files(capture_files);
    let plan = FitPlan {
        start: FitStart::Sweep,
        mirror: Mirror::Off,
        gaussians,
        floor: gaussians.min(plan.floor),
        coarse: Coarse::NONE,
        steps,
        // Plates have no times, and tell colours best.
        learned: Learned { gains: plan.learned.gains, colors: plan.learned.colors, ..Learned::default() },
        holdout: Holdout::None,
        ..plan.clone()
    };
    let views = views(&small)?;
    let FitRuntime { backend, lpips, checkpoint_every } = runtime;
    let runtime = FitRuntime { backend: &mut *backend, lpips, checkpoint_every };
    let path = plate_path(out);
    let fitted = fit(&plan, &small, &views, None, runtime, &path, on_progress)?;
    if fitted.resumed_at == steps {
        return Ok(fitted);
    }
    // Until the other fit is done, one that is killed starts there.
    Checkpoint::of_finished(&plan, &fitted.fit, &fitted.entries).save(&checkpoint::path_for(&path))?;
    // The plate is fitted: it is not lost to a question about it.
    let named = name_strangers(&fitted.fit, &views, &capture_files.capture.cameras, backend);
    named
        .unwrap_or_else(|error| eprintln!("note: whether cameras show something else is not known: {error}"));
    Ok(fitted)
}

/// The plates as photographs of one frame.
fn views(capture_files: &CaptureFiles) -> Result<TrainingViews, Fault> {
    let (mut train, mut held) = (Vec::new(), Vec::new());
    for (i, camera) in capture_files.capture.cameras.iter().enumerate() {
        let Some(photo) = capture_files.plate_photo(i)? else { continue };
        let photograph = Photograph::from(&photo);
        let view = TrainingView { camera_id: i, camera: camera.camera.clone(), time: 0.0, photograph };
        match camera.held {
            true => held.push(view),
            false => train.push((PhotoId { frame: 0, camera: i }, view)),
        }
    }
    let responses = responses(&capture_files.capture);
    Ok(TrainingViews { train, held, timeline: Timeline::even(1), responses })
}
