//! What a fit makes of the background: mattes of photographs without masks, and a plate behind the field.

use std::path::Path;

use clap::ValueEnum;
use codec::{ClipInfo, Field};
use program::{Fault, output};
use refine::capture::Holdout;
use refine::fit::{Learned, Rig};

use crate::capture::{BackgroundSource, CaptureFiles, PICTURES_MIN};
use crate::fields::{FitRecord, fitted_field_file, import};
use crate::fit::{self, FitPlan, FitRuntime, FitStart, FittedPlate, PlatePlan, TrainingViews, log};
use crate::input::Input;
use crate::scene::plate_path;

use super::fit_progress::{fit_bar, show};

/// Whether a fit makes a plate. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum PlateWhen {
    /// Where cameras stand still, and no photograph has a mask or the capture states plates
    #[default]
    Auto,
    /// Always
    On,
    /// Never: what masks show is the subject, or without masks everything
    Off,
}

impl PlateWhen {
    /// What a fit makes of the background; finds the plates if it needs them.
    ///
    /// # Errors
    /// Those of [`CaptureFiles::find_plates`]; [`Fault::Data`] if a plate is wanted and photographs show none.
    pub(super) fn find(
        self,
        capture_files: &mut CaptureFiles,
        holdout: Holdout,
    ) -> anyhow::Result<PlatePlan> {
        let is_wanted = match self {
            PlateWhen::On => {
                if capture_files.is_cut_out()? {
                    let what = "--plate on: photographs are transparent or black around the subject, so there is nothing \
                                to make a plate of; leave it out";
                    return Err(Fault::Data(what.into()).into());
                }
                true
            }
            PlateWhen::Off => false,
            PlateWhen::Auto => capture_files.capture.frames() > 1 && tells_plate(capture_files, holdout)?,
        };
        if !is_wanted {
            capture_files.forget_mattes();
            return Ok(PlatePlan::None);
        }
        capture_files.find_plates(holdout)?;
        Ok(PlatePlan::Fitted)
    }
}

/// Whether photographs tell plates; says in a line why not, where they have no masks either.
fn tells_plate(capture_files: &CaptureFiles, holdout: Holdout) -> anyhow::Result<bool> {
    Ok(match capture_files.background_source(holdout)? {
        BackgroundSource::Plates => true,
        BackgroundSource::Masks | BackgroundSource::CutOut => false,
        BackgroundSource::Few(camera, photographs) => {
            eprintln!(
                "note: camera {camera} has {photographs} of the {PICTURES_MIN} photographs that a plate needs, so all that is \
                 seen is fitted as one; plates or masks in capture.json tell the subject apart"
            );
            false
        }
    })
}

/// Fits the plate that belongs behind the field `out`, if the plan says so; `capture_files` and `views`, its photographs, get
/// the colours of cameras that it learned. A fit that starts from a field has the field's plate.
///
/// # Errors
/// Those of [`fit::fit_plate`]; [`Fault::Data`] if nothing is in front of the plates.
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
    fit::name_covered(views, &capture_files.capture.cameras);
    let bar = fit_bar(plan.plate_steps());
    bar.println(format!("plate: {}", plate_path(out).display()));
    let fitted = fit::fit_plate(plan, capture_files, runtime, out, &mut |progress| show(&bar, progress))?;
    bar.finish_and_clear();
    if let Some(rig) = fitted.fit.rig() {
        for (i, camera) in capture_files.capture.cameras.iter_mut().enumerate() {
            camera.response = rig.response(i);
            views.responses[i] = camera.response;
        }
    }
    let learned = fitted.fit.rig().map_or(plan.learned, Rig::learned);
    Ok(Some(FittedPlate { field: fitted.fit.to_field(), learned }))
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
