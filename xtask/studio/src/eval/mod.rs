//! Compares a field, a package or a folder of pictures with the photographs of a capture.
//!
//! Measures: the photographs and their subject (`photographs`), what needs all photographs of a camera (`by_camera`), means
//! of each split (`means`), what predicts held frames without a fit (`blended`), held cameras after a fit (`held_cameras`),
//! means over scenes (`scenes`), prefixes of a package (`prefixes`), frames of a take (`over_time`), cost for a player
//! (`fragments`). Pictures, as in the paper's appendices: beside the photographs (`strips`), between captured frames
//! (`quarter`), from new viewpoints (`free`).

mod blended;
mod by_camera;
mod fragments;
mod free;
mod held_cameras;
mod means;
mod over_time;
mod photographs;
mod prefixes;
mod quarter;
mod scenes;
mod sheet;
mod strips;

use std::path::{Path, PathBuf};

use anyhow::bail;
use program::Fault;
use refine::capture::{Holdout, Photo, PhotoId, Split};
use refine::fit::{Lpips, LpipsError};
use refine::image::Image;
use refine::metrics::{ImageMetrics, TemporalMedian};
use refine::reference::{self, Order};

use crate::capture::{CaptureFiles, find_image, read_picture};
use crate::input::Input;
pub use by_camera::Judged;
use by_camera::{Measured, Medians, align, by_camera};

pub use blended::BlendedPhotographs;
pub use fragments::fragments_per_lit_pixel;
pub use free::free_views;
pub use held_cameras::{HeldCamera, HeldCameras, held_photos, judge_held_cameras};
pub use means::{SplitMeasures, csv, means, parse_csv, table};
pub use over_time::{FrameErrors, over_time};
pub use photographs::Photographs;
pub use prefixes::{PrefixEval, PrefixEvalStep, eval_prefixes};
pub use quarter::{Interval, fastest_interval, quarter_frames};
pub use scenes::{SceneMeasures, Spread, over_scenes, scenes_table};
pub(crate) use sheet::Crop;
pub use strips::{Strip, Strips};

/// What is compared with photographs.
#[derive(Debug)]
pub enum Subject {
    /// A field or a package, drawn by the reference renderer.
    Drawn(Box<Input>),
    /// A folder of pictures, named as the photographs are.
    Pictures(PathBuf),
}

impl Subject {
    /// Loads a field file, a package, a folder that holds one, or a folder of pictures of the photographs
    /// of `capture_files`.
    ///
    /// # Errors
    /// [`Fault::Data`] if `path` is none of them.
    pub fn load(path: &Path, capture_files: &CaptureFiles) -> anyhow::Result<Subject> {
        let has_picture =
            |photo_id: &PhotoId| find_image(&path.join(capture_files.name(*photo_id))).is_some();
        match path.is_dir() && capture_files.capture.photos.iter().any(has_picture) {
            true => Ok(Subject::Pictures(path.to_owned())),
            false => Ok(Subject::Drawn(Box::new(Input::load(path)?))),
        }
    }

    /// Whether it has a picture of a photograph's view.
    fn shows(&self, capture_files: &CaptureFiles, photo_id: PhotoId) -> bool {
        match self {
            Subject::Drawn(_) => true,
            Subject::Pictures(folder) => find_image(&folder.join(capture_files.name(photo_id))).is_some(),
        }
    }

    /// Checks before any work that its first picture can be compared. What is drawn always can.
    ///
    /// # Errors
    /// [`Fault::Data`] if the picture cannot be read or has another size than its photograph.
    pub fn check(&self, capture_files: &CaptureFiles) -> Result<(), Fault> {
        let Subject::Pictures(_) = self else { return Ok(()) };
        let first =
            capture_files.capture.photos.iter().find(|photo_id| self.shows(capture_files, **photo_id));
        first.map_or(Ok(()), |photo_id| self.picture(capture_files, *photo_id).map(drop))
    }

    /// Whether it is drawn before a plate.
    pub fn has_plate(&self) -> bool {
        matches!(self, Subject::Drawn(input) if input.has_plate())
    }

    /// Its picture of a photograph's view, if any.
    fn picture(&self, capture_files: &CaptureFiles, photo_id: PhotoId) -> Result<Option<Picture>, Fault> {
        let camera = &capture_files.capture.cameras[photo_id.camera].camera;
        match self {
            Subject::Drawn(input) => {
                let (scene, t) = (input.to_reference(), capture_files.capture.clip_time(photo_id));
                let (image, alpha) = reference::render_with_subject(&scene, camera, t, Order::Depth);
                Ok(Some(Picture { image, subject: Some(alpha) }))
            }
            Subject::Pictures(folder) => match find_image(&folder.join(capture_files.name(photo_id))) {
                Some(path) => Ok(Some(Picture { image: read_picture(&path, camera)?, subject: None })),
                None => Ok(None),
            },
        }
    }
}

/// A picture of a subject.
struct Picture {
    image: Image,
    /// Alpha of what is drawn before a plate, pixel by pixel; `None` of a picture that is not drawn.
    subject: Option<Vec<f64>>,
}

/// A picture, its photograph and their measures.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a> {
    /// Camera and frame.
    pub photo_id: PhotoId,
    /// The split of the photograph.
    pub split: Split,
    /// The measures.
    pub measures: &'a ImageMetrics,
    /// The picture.
    pub picture: &'a Image,
    /// The photograph; its alpha is the subject.
    pub photo: &'a Photo,
    /// The median over time of the photograph's camera.
    pub median: Option<&'a TemporalMedian>,
}

/// The split of each photograph of `capture_files`.
///
/// # Errors
/// [`Fault::Data`] if no photograph is left for fitting.
pub(crate) fn splits(capture_files: &CaptureFiles, holdout: Holdout) -> Result<Vec<(PhotoId, Split)>, Fault> {
    Split::assign(&capture_files.capture, holdout).map_err(|error| Fault::Data(error.to_string()))
}

/// Reads a photograph and checks that it is large enough for `lpips`.
fn photo_for(
    photographs: &Photographs,
    photo_id: PhotoId,
    lpips: Option<&Lpips<f32>>,
) -> Result<Photo, Fault> {
    let photo = photographs.read(photo_id)?;
    if let Some(lpips) = lpips {
        let Image { width, height, .. } = photo.image;
        let too_small = |error: LpipsError| {
            Fault::Data(format!("{}: {error}; leave --lpips-weights out", photographs.files.name(photo_id)))
        };
        lpips.check_size(width as usize, height as usize).map_err(too_small)?;
    }
    Ok(photo)
}

/// Compares pictures of `subject` with all `photographs`; skips those whose picture a folder lacks. Measures LPIPS if its
/// network is given. Calls `on_photo` for each photograph, camera by camera, with `None` if it is skipped.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or no picture is left to compare; those of `on_photo`.
pub fn judge(
    subject: &Subject,
    photographs: &Photographs,
    holdout: Holdout,
    lpips: Option<&Lpips<f32>>,
    on_photo: impl FnMut(Option<Comparison>) -> Result<(), Fault>,
) -> anyhow::Result<Vec<Judged>> {
    judge_photos(subject, photographs, splits(&photographs.files, holdout)?, lpips, on_photo)
}

/// Compares pictures of `subject` with these photographs, as [`judge`] does.
fn judge_photos(
    subject: &Subject,
    photographs: &Photographs,
    photos: Vec<(PhotoId, Split)>,
    lpips: Option<&Lpips<f32>>,
    mut on_photo: impl FnMut(Option<Comparison>) -> Result<(), Fault>,
) -> anyhow::Result<Vec<Judged>> {
    let capture_files = &photographs.files;
    let mut medians = Medians::new(capture_files);
    let mut measured = Vec::new();
    for (photo_id, split) in by_camera(photos) {
        if !subject.shows(capture_files, photo_id) {
            on_photo(None)?;
            continue;
        }
        // The photograph first: reading it checks its size against the camera's.
        let mut photo = photo_for(photographs, photo_id, lpips)?;
        if let Some(Picture { image: picture, subject }) = subject.picture(capture_files, photo_id)? {
            let overlap = subject.and_then(|drawn| photographs.tell(photo_id, &mut photo, &drawn));
            let median = medians.median(photo_id.camera)?;
            let (measures, sums) = ImageMetrics::with_sums(&picture, &photo, median, lpips);
            on_photo(Some(Comparison {
                photo_id,
                split,
                measures: &measures,
                picture: &picture,
                photo: &photo,
                median,
            }))?;
            measured.push(Measured { photo_id, split, measures, sums, overlap });
        }
    }
    if measured.is_empty() {
        bail!(Fault::Data(
            "there is no picture of any photograph; name the pictures as the photographs".into()
        ));
    }
    Ok(align(&measured, &capture_files.capture))
}

#[cfg(test)]
mod fixtures {
    use codec::Camera;
    use refine::capture::{CalibratedCamera, Lens, Response};

    /// A camera in the origin, in time with its frames.
    pub(super) fn camera(held: bool) -> CalibratedCamera {
        CalibratedCamera {
            name: "c".into(),
            camera: Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 8, 8),
            lens: Lens::default(),
            time_offset_s: 0.0,
            response: Response::NEUTRAL,
            held,
            device: None,
        }
    }
}
