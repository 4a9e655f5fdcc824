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

/// Maximum number of frames from one fitted frame to the next.
const FRAMES_MAX: usize = 4;

/// The time from one fitted frame to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interval {
    /// Index of a fitted camera.
    pub camera: usize,
    /// The two frames.
    pub frames: [usize; 2],
}

impl Interval {
    /// Clip time halfway.
    pub fn center(&self, capture_files: &CaptureFiles) -> f64 {
        let photo_id = |frame| PhotoId { camera: self.camera, frame };
        let [start, end] = self.frames.map(|frame| capture_files.capture.clip_time(photo_id(frame)));
        0.5 * (start + end)
    }
}

/// The interval in which the photographs of the first fitted camera change most; `None` if there are fewer
/// than two fitted frames.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or no photograph is left for fitting.
pub fn fastest_interval(capture_files: &CaptureFiles, holdout: Holdout) -> Result<Option<Interval>, Fault> {
    let splits = splits(capture_files, holdout)?;
    let mut train: Vec<PhotoId> =
        splits.iter().filter(|(_, split)| *split == Split::Train).map(|(photo_id, _)| *photo_id).collect();
    train.sort_by_key(|photo_id| (photo_id.camera, photo_id.frame));
    let near =
        |pair: &[PhotoId]| pair[0].camera == pair[1].camera && pair[1].frame - pair[0].frame <= FRAMES_MAX;
    let Some(camera) = train.windows(2).find(|pair| near(pair)).map(|pair| pair[0].camera) else {
        return Ok(None);
    };
    train.retain(|photo_id| photo_id.camera == camera);
    let mut fastest_interval: Option<(f64, Interval)> = None;
    let mut before: Option<Photo> = None;
    for (i, photo_id) in train.iter().enumerate() {
        let photo = capture_files.photo(*photo_id)?;
        if let (Some(before), Some(last)) = (&before, i.checked_sub(1).map(|i| train[i]))
            && near(&[last, *photo_id])
        {
            let change = photo.image.squared_error(&before.image);
            if fastest_interval.is_none_or(|(most, _)| change > most) {
                fastest_interval = Some((change, Interval { camera, frames: [last.frame, photo_id.frame] }));
            }
        }
        before = Some(photo);
    }
    Ok(fastest_interval.map(|(_, interval)| interval))
}

/// Two rows of pictures, one column per quarter of a frame, cropped to the subject: the photographs of the
/// interval, black between frames, and `input` rendered at that time.
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
        let photo_id = PhotoId { camera: number, frame };
        photos.push(match capture.photos.contains(&photo_id) {
            true => Some(capture_files.photo(photo_id)?),
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
        let [this, next] =
            [frame, (frame + 1).min(end)].map(|frame| capture.clip_time(PhotoId { camera: number, frame }));
        let t = this + part * (next - this);
        let bottom = reference::render(&input.to_reference(), camera, t, Order::Depth);
        (crop.apply(&top), crop.apply(&bottom))
    };
    let (top, bottom) = (0..=quarters).map(column).unzip();
    Ok(sheet(&[top, bottom]))
}
