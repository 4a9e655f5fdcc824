//! [`judge_baselines`]: predictions of held frames from the fitted frames around them.
//!
//! A dynamic field must predict a held frame better than its own picture at the nearest fitted frame,
//! and better than a blend of its pictures at the two fitted frames around the held one.

use codec::Camera;
use program::Fault;
use refine::capture::{Holdout, Split};
use refine::fit::Lpips;
use refine::image::Image;
use refine::metrics::ImageMetrics;
use refine::reference::{self, Order};

use super::{Judged, Measured, Medians, align, by_camera, photo_for, splits};
use crate::capture::CaptureFiles;
use crate::input::Input;

/// A prediction of a held frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Baseline {
    /// The picture at the nearest fitted frame; the earlier one of a tie.
    Nearest,
    /// The pictures at the two fitted frames around it, blended linearly in time.
    Blend,
}

impl Baseline {
    /// All baselines.
    pub const ALL: [Baseline; 2] = [Baseline::Nearest, Baseline::Blend];

    /// Key in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Baseline::Nearest => "nearest_frame",
            Baseline::Blend => "blended_frames",
        }
    }
}

/// Compares both baselines, in the order of [`Baseline::ALL`], with all photographs of held frames; empty
/// if no frame is held. Calls `on_photo` after each photograph.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or no photograph is left for fitting.
pub fn judge_baselines(
    input: &Input,
    capture_files: &CaptureFiles,
    holdout: Holdout,
    lpips: Option<&Lpips<f32>>,
    mut on_photo: impl FnMut(),
) -> Result<[Vec<Judged>; 2], Fault> {
    let splits = splits(capture_files, holdout)?;
    let fitted = splits.iter().filter(|(_, split)| *split == Split::Train);
    let mut times: Vec<f64> =
        fitted.map(|(photo_id, _)| capture_files.capture.clip_time(*photo_id)).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let held = by_camera(splits.into_iter().filter(|(_, split)| split.holds_frame()).collect());
    let mut medians = Medians::new(capture_files);
    let mut measured = [Vec::new(), Vec::new()];
    for (photo_id, split) in held {
        let photo = photo_for(capture_files, photo_id, lpips)?;
        let camera = &capture_files.capture.cameras[photo_id.camera].camera;
        let guesses = guesses(input, camera, &around(&times, capture_files.capture.clip_time(photo_id)));
        let median = medians.median(photo_id.camera)?;
        for (measured, guess) in measured.iter_mut().zip(guesses) {
            let (measures, sums) = ImageMetrics::with_sums(&guess, &photo, median, lpips);
            measured.push(Measured { photo_id, split, measures, sums });
        }
        on_photo();
    }
    Ok(measured.map(|measured| align(&measured)))
}

/// A clip time and its weight in a blend.
type Weighted = (f64, f64);

/// The last of `times`, sorted ascending, at or before `t`, and the first after it, with the weights of
/// linear interpolation. Beyond either end, that end twice, with weights 1 and 0.
fn around(times: &[f64], t: f64) -> [Weighted; 2] {
    let after = times.partition_point(|time| *time <= t);
    match (after.checked_sub(1).map(|i| times[i]), times.get(after)) {
        (Some(before), Some(after)) => {
            let part = (t - before) / (after - before);
            [(before, 1.0 - part), (*after, part)]
        }
        (Some(end), None) => [(end, 1.0), (end, 0.0)],
        (None, Some(end)) => [(*end, 1.0), (*end, 0.0)],
        (None, None) => unreachable!("there is something to fit to"),
    }
}

fn guesses(input: &Input, camera: &Camera, around: &[Weighted; 2]) -> [Image; 2] {
    let [(before, weight), (after, rest)] = *around;
    let draw = |t| reference::render(&input.to_reference(), camera, t, Order::Depth);
    let first = draw(before);
    if rest == 0.0 {
        return [first.clone(), first];
    }
    let second = draw(after);
    let mut blend = Image::new(first.width, first.height);
    for (pixel, (a, b)) in blend.pixels.iter_mut().zip(first.pixels.iter().zip(&second.pixels)) {
        *pixel = std::array::from_fn(|c| weight * a[c] + rest * b[c]);
    }
    [if weight >= rest { first } else { second }, blend]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_between_its_neighbours() {
        let times = [0.0, 0.5, 1.0];
        assert_eq!(around(&times, 0.125), [(0.0, 0.75), (0.5, 0.25)]);
        assert_eq!(around(&times, 0.5), [(0.5, 1.0), (1.0, 0.0)]);
        assert_eq!(around(&times[1..], 0.2), [(0.5, 1.0), (0.5, 0.0)]);
        assert_eq!(around(&times[..2], 0.9), [(0.5, 1.0), (0.5, 0.0)]);
    }
}
