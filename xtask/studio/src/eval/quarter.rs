//! [`quarter_frames`]: pictures between captured frames, at quarters of a frame (the paper's
//! appendix "Rendering Between Captured Frames").

use program::Fault;
use refine::capture::{Holdout, Photo, PhotoId, Split};
use refine::image::Image;
use refine::reference::{self, Order};

use super::sheet::{Crop, sheet};
use super::splits;
use crate::capture::CaptureFiles;
use crate::input::Input;

/// Most frames from one that is fitted to until the next, where some are missing.
const FRAMES_MAX: usize = 4;

/// From a frame that is fitted to until the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interval {
    /// Number of a camera that is fitted to.
    pub camera: usize,
    /// The two frames.
    pub frames: [usize; 2],
}

impl Interval {
    /// Clip time in its middle.
    pub fn middle(&self, capture_files: &CaptureFiles) -> f64 {
        let [start, end] = self.frames.map(|frame| capture_files.capture.times[frame]);
        0.5 * (start + end)
    }
}

/// The interval in which the photographs of the first camera that is fitted to change most; `None`
/// where there are not two frames to fit to.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or nothing is left to fit to.
pub fn swiftest(capture_files: &CaptureFiles, holdout: Holdout) -> Result<Option<Interval>, Fault> {
    let splits = splits(capture_files, holdout)?;
    let mut train: Vec<PhotoId> =
        splits.iter().filter(|(_, split)| *split == Split::Train).map(|(shot, _)| *shot).collect();
    train.sort_by_key(|shot| (shot.camera, shot.frame));
    let near =
        |pair: &[PhotoId]| pair[0].camera == pair[1].camera && pair[1].frame - pair[0].frame <= FRAMES_MAX;
    let Some(camera) = train.windows(2).find(|pair| near(pair)).map(|pair| pair[0].camera) else {
        return Ok(None);
    };
    train.retain(|shot| shot.camera == camera);
    let mut swiftest: Option<(f64, Interval)> = None;
    let mut before: Option<Photo> = None;
    for (i, shot) in train.iter().enumerate() {
        let photo = capture_files.photo(*shot)?;
        if let (Some(before), Some(last)) = (&before, i.checked_sub(1).map(|i| train[i]))
            && near(&[last, *shot])
        {
            let change = photo.image.squared_error(&before.image);
            if swiftest.is_none_or(|(most, _)| change > most) {
                swiftest = Some((change, Interval { camera, frames: [last.frame, shot.frame] }));
            }
        }
        before = Some(photo);
    }
    Ok(swiftest.map(|(_, interval)| interval))
}

/// Two rows, cut to the subject: the photographs of the interval, black where no frame is, and what
/// `input` shows at each quarter of a frame.
///
/// # Errors
/// [`Fault::Data`] where a photograph cannot be read.
pub fn quarter_frames(
    input: &Input,
    capture_files: &CaptureFiles,
    interval: &Interval,
) -> Result<Image, Fault> {
    let Interval { camera: number, frames: [start, end] } = *interval;
    let capture = &capture_files.capture;
    let camera = &capture.cameras[number].camera;
    let mut photos = Vec::new();
    for frame in start..=end {
        let shot = PhotoId { camera: number, frame };
        photos.push(match capture.photos.contains(&shot) {
            true => Some(capture_files.photo(shot)?),
            false => None,
        });
    }
    let taken: Vec<&Photo> = photos.iter().flatten().collect();
    let crop = Crop::around(&taken);
    let quarters = 4 * (end - start);
    let column = |quarter: usize| {
        let frame = start + quarter / 4;
        let part = (quarter % 4) as f64 / 4.0;
        let blank = || Image::new(camera.width, camera.height);
        let photo = photos[frame - start].as_ref().filter(|_| part == 0.0);
        let top = photo.map_or_else(blank, |photo| photo.image.clone());
        let next = capture.times[(frame + 1).min(end)];
        let t = capture.times[frame] + part * (next - capture.times[frame]);
        let bottom = reference::render(&input.to_reference(), camera, t, Order::Depth);
        (crop.of(&top), crop.of(&bottom))
    };
    let (top, bottom) = (0..=quarters).map(column).unzip();
    Ok(sheet(&[top, bottom]))
}
