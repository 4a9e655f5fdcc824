//! What a fit makes of the background: mattes of photographs without masks, and a plate behind the field.

use std::path::Path;

use clap::ValueEnum;
use codec::{ClipInfo, Field};
use program::{Fault, output};
use refine::capture::Holdout;
use refine::fit::{Learned, Rig};

use crate::capture::CaptureFiles;
use crate::fields::{FitRecord, fitted_field_file, import};
use crate::fit::{self, FitPlan, FitRuntime, FitStart, FittedPlate, PlatePlan, TrainingViews, log};
use crate::input::Input;
use crate::scene::plate_path;

use super::fit_progress::{fit_bar, show};

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
    /// What a fit makes of the background; finds the plates if it needs them.
    ///
    /// # Errors
    /// Those of [`CaptureFiles::find_plates`].
    pub(super) fn find(
        self,
        capture_files: &mut CaptureFiles,
        holdout: Holdout,
    ) -> anyhow::Result<PlatePlan> {
        let is_wanted = match self {
            PlateWhen::On => true,
            PlateWhen::Off => false,
            PlateWhen::Auto => capture_files.capture.frames() > 1 && capture_files.can_be_matted(holdout)?,
        };
        if !is_wanted {
            capture_files.forget_mattes();
            return Ok(PlatePlan::None);
        }
        if self == PlateWhen::Auto {
            eprintln!(
                "note: no photograph has a mask: what moves is the subject, in front of a plate of the rest"
            );
        }
        capture_files.find_plates(holdout)?;
        Ok(PlatePlan::Fitted)
    }
}

/// Fits the plate that belongs behind the field `out`, if the plan says so, and writes it beside; `capture_files` and
/// `views`, its photographs, get the colours of cameras that it learned. If it is there and the fit of the field goes on, it
/// is left as it is; a fit that starts from a field has the plate of that. Returns it.
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
) -> anyhow::Result<Option<FittedPlate>> {
    if plan.plate != PlatePlan::Fitted {
        return Ok(None);
    }
    if !views.train.iter().any(|(_, view)| view.photograph.has_subject()) {
        let what = "nothing moves in front of the plates, so there is no subject: give plates without it in capture.json, or \
                    fit all that is seen, --plate off";
        return Err(Fault::Data(what.into()).into());
    }
    if let FitStart::Field(from, _) = &plan.start {
        let plate = Input::load(Path::new(from))?.plate().cloned();
        // Gains that were learned with it are learned further.
        let is_known = views.responses.iter().any(|response| !response.is_neutral());
        let gains = plan.learned.gains || (plan.asks_for_gains() && is_known);
        return Ok(plate.map(|field| FittedPlate { field, learned: Learned { gains, ..plan.learned } }));
    }
    let path = plate_path(out);
    if path.is_file() && fit::has_checkpoint(out) {
        // The checkpoint has its rows and the cameras.
        return Ok(Some(FittedPlate { field: import(&path)?.field, learned: plan.learned }));
    }
    fit::name_covered(views, &capture_files.capture.cameras);
    let bar = fit_bar(plan.plate_steps());
    bar.println(format!("plate: {}", path.display()));
    let fitted = fit::fit_plate(plan, capture_files, runtime, out, &mut |progress| show(&bar, progress))?;
    bar.finish_and_clear();
    if let Some(rig) = fitted.fit.rig() {
        for (i, camera) in capture_files.capture.cameras.iter_mut().enumerate() {
            camera.response = rig.response(i);
            views.responses[i] = camera.response;
        }
    }
    let plate = fitted.fit.to_field();
    write_plate(&path, &plate, &fit::clip_info(capture_files, &[(&plate, [0.0, 1.0])], None))?;
    let learned = fitted.fit.rig().map_or(plan.learned, Rig::learned);
    Ok(Some(FittedPlate { field: plate, learned }))
}

pub(super) fn write_plate(path: &Path, plate: &Field, info: &ClipInfo) -> Result<(), Fault> {
    let record = FitRecord { has_mattes: true, ..FitRecord::default() };
    output::write_durable(path, &fitted_field_file(plate, info, &record))
}

/// Makes the plate beside the finished field `out` the plate that belongs behind it: the plate that was fitted for it,
/// or else the plate of the field that the fit started from, or none.
///
/// # Errors
/// [`Fault::Usage`] if a file cannot be written; the errors of [`Input::load`].
pub(super) fn settle_plate(plan: &FitPlan, out: &Path) -> anyhow::Result<()> {
    let path = plate_path(out);
    match (plan.plate, &plan.start) {
        (PlatePlan::Fitted, _) => return Ok(()),
        (PlatePlan::Mattes, FitStart::Field(from, _)) => {
            let input = Input::load(Path::new(from))?;
            if let Some(plate) = input.plate() {
                return Ok(write_plate(&path, plate, input.info())?);
            }
        }
        _ => {}
    }
    if !path.is_file() {
        return Ok(());
    }
    // It would be drawn behind this field.
    if import(&path).is_ok_and(|plate| FitRecord::from_hints(&plate.hints).is_ok_and(|fit| fit.has_mattes)) {
        for path in [&path, &log::table_path(&path), &log::preview_path(&path)] {
            output::remove(path)?;
        }
        eprintln!("note: {} was of an earlier fit, and is removed", path.display());
    } else {
        eprintln!(
            "note: {} is drawn behind {}; if it does not belong there, remove it",
            path.display(),
            out.display()
        );
    }
    Ok(())
}
