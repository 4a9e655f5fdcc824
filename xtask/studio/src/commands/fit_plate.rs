//! What a fit makes of the background: mattes of photographs without masks, and a plate behind the field.

use std::path::Path;

use clap::ValueEnum;
use program::{Fault, output};

use crate::capture::CaptureFiles;
use crate::export::fitted_field_file;
use crate::fit::{self, FitPlan, FitRuntime, Fitted, TrainingViews};
use crate::import::FitRecord;
use crate::progress::counting;
use crate::scene::plate_path;

use super::fit_progress::show;

/// Whether a fit makes a plate. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum PlateWhen {
    /// Where no photograph has a mask and cameras stand still
    #[default]
    Auto,
    /// Always
    On,
    /// Never: without masks, everything is the subject
    Off,
}

impl PlateWhen {
    /// Finds the plates of a capture where a fit needs them, and returns whether it does.
    ///
    /// # Errors
    /// Those of [`CaptureFiles::find_plates`].
    pub(super) fn find(self, capture_files: &mut CaptureFiles) -> anyhow::Result<bool> {
        let is_wanted = match self {
            PlateWhen::On => true,
            PlateWhen::Off => false,
            PlateWhen::Auto => capture_files.capture.frames() > 1 && capture_files.can_be_matted()?,
        };
        if is_wanted {
            if self == PlateWhen::Auto {
                eprintln!(
                    "note: no photograph has a mask: what moves is the subject, in front of a plate of the rest"
                );
            }
            capture_files.find_plates()?;
        }
        Ok(is_wanted)
    }

    /// The same for a field folder, which has no plate.
    ///
    /// # Errors
    /// Those of [`CaptureFiles::find_plates`]; [`Fault::Usage`] if a plate is asked for.
    pub(super) fn find_mattes(self, capture_files: &mut CaptureFiles) -> anyhow::Result<()> {
        if self == PlateWhen::On {
            let what = "--plate on: a field folder has no plate; fit one with a few seconds, `fit CAPTURE --frames A..B -o \
                        a.ply`, and leave --plate out here: photographs without masks get mattes";
            return Err(Fault::Usage(what.into()).into());
        }
        self.find(capture_files).map(drop)
    }
}

/// Fits the plate that belongs behind the field `out`, and writes it beside; `capture_files` and `views`, its photographs,
/// get the colours of cameras that it learned. `None` if the plan has no plate, or if it is there and the fit of the field
/// goes on.
///
/// # Errors
/// Those of [`fit::fit_plate`]; [`Fault::Data`] if nothing is in front of the plates; [`Fault::Usage`] if the file cannot be
/// written.
pub(super) fn fit_plate(
    plan: &FitPlan,
    capture_files: &mut CaptureFiles,
    views: &mut TrainingViews,
    runtime: FitRuntime,
    out: &Path,
) -> anyhow::Result<Option<Fitted>> {
    let path = plate_path(out);
    if !plan.has_plate {
        // That of an earlier fit would be drawn behind this one.
        if output::remove(&path)? {
            eprintln!("note: {} is of an earlier fit, and was removed", path.display());
        }
        return Ok(None);
    }
    if !views.train.iter().any(|(_, view)| view.photograph.has_subject()) {
        let what = "nothing moves in front of the plates, so there is no subject: fit one frame, --frames A..B, or give \
                    plates without the subject in capture.json";
        return Err(Fault::Data(what.into()).into());
    }
    if path.is_file() && fit::has_checkpoint(out) {
        return Ok(None);
    }
    let bar = counting(plan.steps, "steps");
    bar.println(format!("plate: {}", path.display()));
    let fitted = fit::fit_plate(plan, capture_files, runtime, out, &mut |progress| show(&bar, progress))?;
    bar.finish_and_clear();
    if let Some(rig) = fitted.fit.rig() {
        for (i, camera) in capture_files.capture.cameras.iter_mut().enumerate() {
            camera.response = rig.response(i);
            views.responses[i] = camera.response;
        }
    }
    let info = fit::clip_info(capture_files);
    output::write_durable(&path, &fitted_field_file(&fitted.fit.to_field(), &info, &FitRecord::default()))?;
    fit::remove_checkpoint(&path)?;
    Ok(Some(fitted))
}
