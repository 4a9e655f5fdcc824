//! [`name_strangers`]: cameras whose photographs show something else than those of the others, or nothing.
//!
//! The plate of such a camera contradicts the others, so a field that is fitted to all of them cannot show it. Where no other
//! camera looks, nothing contradicts it, and it is fitted. A camera without light is fitted as one of little gain, so its
//! plate itself tells.

use refine::capture::CalibratedCamera;
use refine::fit::{Backend, DeviceError, Fit, Photograph, RenderedImage, Run};
use refine::image::psnr;
use refine::metrics::median;

use super::training_views::TrainingViews;

/// A camera is a stranger if less of its plate's variance is explained, and its PSNR is so much below the median of all. After
/// 2000 steps on a dome, cameras with right pictures have 0.49 and more, one with another's -0.04.
const EXPLAINED_MAX: f64 = 0.1;
const BELOW_MEDIAN_DB: f64 = 4.0;

/// A camera has no light if its plate's [`brightness`] is below this level of 255, and below this share of the median.
const DARK_MAX: u8 = 20;
const DARK_SHARE_MAX: f64 = 0.25;

/// Share of a plate's pixels, the brightest, that may be lamps or noise.
const BRIGHTEST: f64 = 0.01;

/// Steps from which on the plate of a right camera is explained.
const STEPS_MIN: u64 = 2000;

/// Names the strangers among `cameras` in a line each, from the fit to the plates that are `views`.
///
/// # Errors
/// A [`DeviceError`].
pub(super) fn name_strangers(
    fit: &Fit,
    views: &TrainingViews,
    cameras: &[CalibratedCamera],
    backend: &mut dyn Backend,
) -> Result<(), DeviceError> {
    let name = |i: usize| &cameras[views.train[i].1.camera_id].name;
    let brightnesses: Vec<u8> = views.train.iter().map(|(_, view)| brightness(&view.photograph)).collect();
    for i in dark(&brightnesses) {
        eprintln!(
            "note: camera {} shows next to nothing (levels to {} of 255): check its light and its lid; \"held\": true in \
             capture.json leaves it out",
            name(i),
            brightnesses[i]
        );
    }
    if fit.steps_done() < STEPS_MIN {
        return Ok(());
    }
    let mut run = Run::start(fit.clone(), backend)?;
    let mut errors = Vec::new();
    for (_, view) in &views.train {
        errors.push(PlateError::of(&run.render(view)?, &view.photograph));
    }
    for i in strangers(&errors) {
        eprintln!(
            "note: camera {} shows something else than the others do ({:.1} dB, they {:.1}): check its calibration, and \
             whether its files are of another camera; \"held\": true in capture.json leaves it out",
            name(i),
            errors[i].psnr_db,
            median_db(&errors)
        );
    }
    Ok(())
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
        let (mut count, mut squares, mut sum, mut sum_of_squares) = (0, 0.0, 0.0, 0.0);
        let seen = (0..plate.pixels.len()).filter(|pixel| plate.is_valid(*pixel));
        for (channel, pixel) in seen.flat_map(|pixel| (0..3).map(move |channel| (channel, pixel))) {
            let taken = f64::from(plate.pixels[pixel][channel]) / 255.0;
            count += 1;
            squares += (f64::from(picture.pixels[pixel][channel]) - taken).powi(2);
            sum += taken;
            sum_of_squares += taken * taken;
        }
        let deviations = sum_of_squares - sum * sum / f64::from(count);
        PlateError { psnr_db: psnr(squares, count as usize / 3), explained: 1.0 - squares / deviations }
    }
}

/// Indices of the plates that the fit of all cannot show: each is explained no better than by one colour, and is far worse
/// than most.
fn strangers(errors: &[PlateError]) -> Vec<usize> {
    let limit = median_db(errors) - BELOW_MEDIAN_DB;
    let is_strange = |error: &PlateError| error.explained < EXPLAINED_MAX && error.psnr_db < limit;
    (0..errors.len()).filter(|i| is_strange(&errors[*i])).collect()
}

/// The level that the pixels of a plate have at most, but for the brightest.
fn brightness(plate: &Photograph) -> u8 {
    let seen = (0..plate.pixels.len()).filter(|pixel| plate.is_valid(*pixel));
    let level = |[r, g, b, _]: [u8; 4]| r.max(g).max(b);
    let mut levels: Vec<u8> = seen.map(|pixel| level(plate.pixels[pixel])).collect();
    levels.sort_unstable();
    let most = ((1.0 - BRIGHTEST) * levels.len() as f64) as usize;
    levels.get(most).copied().unwrap_or(u8::MAX)
}

/// Indices of the plates without light, where the others have some.
fn dark(brightnesses: &[u8]) -> Vec<usize> {
    let Some(typical) = median(brightnesses.iter().map(|level| f64::from(*level)).collect()) else {
        return Vec::new();
    };
    let limit = DARK_SHARE_MAX * typical;
    let is_dark = |level: u8| level < DARK_MAX && f64::from(level) < limit;
    (0..brightnesses.len()).filter(|i| is_dark(brightnesses[*i])).collect()
}

/// Median of the PSNR in dB; 0 of no plates.
fn median_db(errors: &[PlateError]) -> f64 {
    median(errors.iter().map(|error| error.psnr_db).collect()).unwrap_or(0.0)
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
    fn a_camera_without_light_is_found_where_others_have_some() {
        let plate = |level: u8, lamp: u8| {
            let pixels = (0..200).map(|i| [if i == 7 { lamp } else { level }, 0, 0, 255]).collect();
            brightness(&Photograph { width: 20, height: 10, pixels, valid: Vec::new() })
        };
        let (lit, closed) = (plate(120, 120), plate(3, 255));
        assert_eq!((lit, closed), (120, 3), "one pixel of noise is no light");
        assert_eq!(dark(&[lit, closed, lit]), [1]);
        assert!(dark(&[closed, closed, closed]).is_empty(), "a night");
        assert!(dark(&[lit, plate(30, 30), lit]).is_empty(), "a dim camera");
    }

    #[test]
    fn a_plate_of_one_colour_is_no_stranger_if_it_is_shown() {
        let plain = PlateError { psnr_db: 35.0, explained: f64::NEG_INFINITY };
        let noisy = error(|i| 0.16 + 0.006 * (i ^ 15) as f64);
        assert!(strangers(&[noisy, plain, noisy]).is_empty());
    }
}
