//! [`fit_plate`]: the static field of what is behind the subject, fitted to the plates of the cameras.
//!
//! Plates show one instant that lasts, so this is a fit to a capture of one frame, which needs no masks.

use std::path::Path;

use program::Fault;
use refine::anchor::Mirror;
use refine::capture::{Holdout, PhotoId};
use refine::fit::{DeviceError, Learned, Photograph, RenderedImage, Run, Timeline, TrainingView};

use super::plan::{Coarse, FitPlan, FitStart, default_gaussians};
use super::training_views::{TrainingViews, responses};
use super::{FitProgress, FitRuntime, Fitted, fit, on_device};
use crate::capture::CaptureFiles;
use crate::scene::plate_path;

/// A plate gets as many Gaussians as a subject in so many frames: a room is larger than who is in it, and does not move.
const FRAMES: usize = 4;

/// A camera shows something else than the others if less of its plate's variance is explained, and its PSNR is so much below
/// their median. After 2000 steps on a dome, cameras with right pictures have 0.49 and more, one with another's -0.04.
const STRANGER_EXPLAINED: f64 = 0.1;
const STRANGER_DB: f64 = 4.0;

/// Fits a static field to the plates of the cameras that are not held out. `out` is the path of the field that belongs in
/// front of it. The plate gets no more steps and Gaussians than `plan` has. What it learns of the cameras' colours is what
/// the other fit starts from.
///
/// # Errors
/// Those of [`fit`]; [`Fault::Data`] if a plate cannot be read.
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
    let fitted = fit(&plan, &small, &views, None, runtime, &plate_path(out), on_progress)?;
    let mut run = Run::start(fitted.fit.clone(), backend).map_err(on_device)?;
    let pictures: Result<Vec<RenderedImage<f32>>, DeviceError> =
        views.train.iter().map(|(_, view)| run.render(view)).collect();
    let fits: Vec<PlateError> = views
        .train
        .iter()
        .zip(pictures.map_err(on_device)?)
        .map(|((_, view), picture)| PlateError::of(&picture, &view.photograph))
        .collect();
    for i in strangers(&fits) {
        eprintln!(
            "note: camera {} shows something else than the others do ({:.1} dB, they {:.1}): check its calibration, and whether its \
             files are of another camera; \"held\": true in capture.json leaves it out",
            capture_files.capture.cameras[views.train[i].1.camera_id].name,
            fits[i].psnr_db,
            typical_psnr_db(&fits)
        );
    }
    Ok(fitted)
}

/// How far the picture of a plate is from it.
#[derive(Clone, Copy, Debug)]
struct PlateError {
    psnr_db: f64,
    /// Share of the plate's variance that the picture explains: 1 if it is exact, 0 if it is as good as the mean colour.
    explained: f64,
}

impl PlateError {
    fn of(picture: &RenderedImage<f32>, plate: &Photograph) -> PlateError {
        let (mut count, mut squares, mut sum, mut sum_of_squares) = (0.0, 0.0, 0.0, 0.0);
        let seen = (0..plate.pixels.len()).filter(|pixel| plate.is_valid(*pixel));
        for (channel, pixel) in seen.flat_map(|pixel| (0..3).map(move |channel| (channel, pixel))) {
            let taken = f64::from(plate.pixels[pixel][channel]) / 255.0;
            count += 1.0;
            squares += (f64::from(picture.pixels[pixel][channel]) - taken).powi(2);
            sum += taken;
            sum_of_squares += taken * taken;
        }
        let variance = sum_of_squares - sum * sum / count;
        PlateError { psnr_db: -10.0 * (squares / count).log10(), explained: 1.0 - squares / variance }
    }
}

/// Indices of the plates that the fit of all cannot show: each is explained no better than by one colour, and is far worse
/// than most.
fn strangers(errors: &[PlateError]) -> Vec<usize> {
    let most = typical_psnr_db(errors) - STRANGER_DB;
    let is_strange = |error: &PlateError| error.explained < STRANGER_EXPLAINED && error.psnr_db < most;
    (0..errors.len()).filter(|i| is_strange(&errors[*i])).collect()
}

/// Median of the PSNR in dB.
fn typical_psnr_db(errors: &[PlateError]) -> f64 {
    let mut sorted: Vec<f64> = errors.iter().map(|error| error.psnr_db).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of a ramp, and plates that are it, darker, or something else.
    fn error(plate: impl Fn(usize) -> f64) -> PlateError {
        let ramp = |i: usize| 0.2 + 0.006 * i as f64;
        let pixels = (0..100).map(|i| [ramp(i) as f32; 4]).collect();
        let picture = RenderedImage { width: 10, height: 10, pixels };
        let pixels = (0..100).map(|i| [(255.0 * plate(i)) as u8; 4]).collect();
        PlateError::of(&picture, &Photograph { width: 10, height: 10, pixels, valid: Vec::new() })
    }

    #[test]
    fn a_camera_that_shows_something_else_or_nothing_is_found() {
        let (right, noisy) = (error(|i| 0.21 + 0.006 * i as f64), error(|i| 0.16 + 0.006 * (i ^ 15) as f64));
        let (other, dark) = (error(|i| 0.8 - 0.006 * i as f64), error(|_| 0.0));
        assert!(right.explained > 0.99 && noisy.explained > 0.8 && other.explained < 0.0, "{noisy:?}");
        assert_eq!(strangers(&[right, other, right, noisy, dark]), [1, 4]);
        // With nothing to compare with, the capture is as it is.
        assert!(
            strangers(&[right, noisy]).is_empty()
                && strangers(&[other]).is_empty()
                && strangers(&[]).is_empty()
        );
    }

    #[test]
    fn a_plate_of_one_colour_is_no_stranger_if_it_is_shown() {
        let plain = PlateError { psnr_db: 35.0, explained: f64::NEG_INFINITY };
        let right = error(|i| 0.21 + 0.006 * i as f64);
        assert!(strangers(&[right, plain, right]).is_empty());
    }
}
