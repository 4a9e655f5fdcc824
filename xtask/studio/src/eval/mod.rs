//! How well a field, a package or anybody's pictures show what a capture's cameras saw: measures
//! (`means`), those of who knows only the frames around a held one (`baselines`), those of several
//! scenes (`scenes`), and pictures to look at, as in the paper's appendices: beside the photographs
//! (`strips`), between captured frames (`quarter`), from where no camera stood (`free`), and of the
//! first layers of a package (`ladder`).

mod baselines;
mod free;
mod ladder;
mod means;
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
use refine::metrics::ImageMetrics;
use refine::reference::{self, Order};

use crate::capture::{CaptureFiles, find_image, read_picture};
use crate::input::Input;

pub use baselines::{Baseline, judge_baselines};
pub use free::free_views;
pub use ladder::{Ladder, Rung, ladder};
pub use means::{SplitMeasures, baseline_rows, csv, means, table};
pub use quarter::{Interval, quarter_frames, swiftest};
pub use scenes::{SceneMeasures, Spread, over_scenes, scenes_table};
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
    /// A field file, a package, a folder that holds one, or else a folder of pictures of the shots
    /// of `capture_files`.
    ///
    /// # Errors
    /// [`Fault::Data`] that says what is there instead.
    pub fn load(path: &Path, capture_files: &CaptureFiles) -> anyhow::Result<Subject> {
        let has_picture = |shot: &PhotoId| find_image(&path.join(capture_files.name(*shot))).is_some();
        match path.is_dir() && capture_files.capture.photos.iter().any(has_picture) {
            true => Ok(Subject::Pictures(path.to_owned())),
            false => Ok(Subject::Drawn(Box::new(Input::load(path)?))),
        }
    }

    /// Whether it has a picture of a shot.
    fn shows(&self, capture_files: &CaptureFiles, shot: PhotoId) -> bool {
        match self {
            Subject::Drawn(_) => true,
            Subject::Pictures(folder) => find_image(&folder.join(capture_files.name(shot))).is_some(),
        }
    }

    /// Its picture of a shot; `None` if there is none.
    fn picture(&self, capture_files: &CaptureFiles, shot: PhotoId) -> Result<Option<Image>, Fault> {
        let camera = &capture_files.capture.cameras[shot.camera].camera;
        match self {
            Subject::Drawn(input) => {
                let t = capture_files.capture.times[shot.frame];
                Ok(Some(reference::render(&input.to_reference(), camera, t, Order::Depth)))
            }
            Subject::Pictures(folder) => match find_image(&folder.join(capture_files.name(shot))) {
                Some(path) => read_picture(&path, camera).map(Some),
                None => Ok(None),
            },
        }
    }
}

/// Measures of one picture.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Camera and frame.
    pub shot: PhotoId,
    /// What the photograph is to a fit.
    pub split: Split,
    /// How alike both are.
    pub measures: ImageMetrics,
}

/// A picture that was just judged.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    /// What came of it.
    pub judged: &'a Judged,
    /// The picture.
    pub picture: &'a Image,
    /// The photograph that it was compared with.
    pub photo: &'a Photo,
}

/// The split of each photograph of `capture_files`.
fn splits(capture_files: &CaptureFiles, holdout: Holdout) -> Result<Vec<(PhotoId, Split)>, Fault> {
    Split::assign(&capture_files.capture, holdout).map_err(|error| Fault::Data(error.to_string()))
}

/// A photograph, of which `lpips` can be measured.
fn photo_for(
    capture_files: &CaptureFiles,
    shot: PhotoId,
    lpips: Option<&Lpips<f32>>,
) -> Result<Photo, Fault> {
    let photo = capture_files.photo(shot)?;
    if let Some(lpips) = lpips {
        let Image { width, height, .. } = photo.image;
        let too_small = |error: LpipsError| Fault::Data(format!("{}: {error}", capture_files.name(shot)));
        lpips.check_size(width as usize, height as usize).map_err(too_small)?;
    }
    Ok(photo)
}

/// Compares pictures of `subject` with all photographs of `capture_files`. Pictures that a folder lacks
/// are left out. LPIPS is measured where its network is given. `on_shot` is called for each shot, with
/// its picture where there is one.
///
/// # Errors
/// [`Fault::Data`] where a file cannot be read or nothing is left to compare.
pub fn judge(
    subject: &Subject,
    capture_files: &CaptureFiles,
    holdout: Holdout,
    lpips: Option<&Lpips<f32>>,
    mut on_shot: impl FnMut(Option<Look>),
) -> anyhow::Result<Vec<Judged>> {
    let mut judged = Vec::new();
    for (shot, split) in splits(capture_files, holdout)? {
        if !subject.shows(capture_files, shot) {
            on_shot(None);
            continue;
        }
        // First the photograph: it must have the size that the picture is drawn in.
        let photo = photo_for(capture_files, shot, lpips)?;
        if let Some(picture) = subject.picture(capture_files, shot)? {
            let one = Judged { shot, split, measures: ImageMetrics::of(&picture, &photo, lpips) };
            on_shot(Some(Look { judged: &one, picture: &picture, photo: &photo }));
            judged.push(one);
        }
    }
    if judged.is_empty() {
        bail!(Fault::Data("there is no picture of any photograph".into()));
    }
    Ok(judged)
}
