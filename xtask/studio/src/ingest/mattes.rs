//! Mattes of all cameras by difference from their plates: `masks/CAMERA/FRAME.png` and `plates/CAMERA.png`.
//!
//! A few cameras at a time: their plates are made, then one thread for each camera decodes its video and writes a mask for each
//! frame of the capture. A camera is a result of the [store](super::store): it is left as it is if all of its files are
//! there, and those that are missing are made again.

use std::path::{Path, PathBuf};

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use program::{Fault, output};
use rayon::prelude::*;
use refine::matte::{GAIN_MAX, Plate};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::options::MattePolicy;
use super::pictures::{jpeg, thumbnail};
use super::plates::{self, PlateFile, PlateSource, colors};
use super::store::{Store, file_name, identity};
use super::videos::RigVideo;
use crate::capture::{PICTURES_MAX, Video, bad};
use crate::messages::unreadable;

/// Paths in the capture, as the manifest has them.
pub(super) const MASKS: &str = "masks/{camera}/{frame:06}.png";
pub(super) const PLATES: &str = "plates/{camera}.png";

/// Cameras that are worked on at a time: each holds its plate and the planes of one matte, up to 110 bytes for a pixel.
const CAMERAS_MAX: usize = 8;

/// Frames of a camera at which the exposure of a plate is compared, and which the page shows.
const COMPARED: usize = 3;

/// Longest side of the page's pictures in pixels.
const SIDE: u32 = 320;

/// Brightness of what is not the subject, on the page.
const BEHIND: f64 = 0.3;

/// The mattes of a camera.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CameraMattes {
    /// What the plate is made of.
    pub source: PlateSource,
    /// Factors by which the pictures are brighter than the plate, in red, green and blue: the median of a few.
    pub gains: [f64; 3],
    /// Share of the subject in each picture that has a matte, from 0 to 1; empty without mattes.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub shares: Vec<f64>,
    /// The plate, then pictures with darkened backgrounds: JPEG in base64.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub(super) thumbnails: Vec<String>,
}

impl CameraMattes {
    /// A copy without the page's pictures.
    pub(super) fn without_pictures(&self) -> CameraMattes {
        CameraMattes { thumbnails: Vec::new(), ..self.clone() }
    }

    /// Mean share of the subject; `None` without mattes.
    pub fn mean_share(&self) -> Option<f64> {
        let len = self.shares.len();
        (len > 0).then(|| self.shares.iter().sum::<f64>() / len as f64)
    }
}

/// Where mattes come from, and for which frames they are.
#[derive(Clone, Copy)]
pub(super) struct MatteSettings<'a> {
    /// Folder of pictures or videos without the subject.
    pub(super) plates: Option<&'a Path>,
    pub(super) policy: MattePolicy,
    pub(super) frames: usize,
    pub(super) fps: f64,
}

/// A camera's part of the step.
struct Task<'a> {
    video: &'a RigVideo,
    plate: PlateFile,
    /// Frames of the video at the frames of the capture; none of them without mattes.
    frames: Vec<Option<usize>>,
    out: &'a Path,
    /// Name and key of its result.
    name: String,
    key: Value,
}

/// Writes plates and masks of all cameras, which start at `starts_s`, in the folder `out`; the flag says whether an earlier
/// run made all of them.
///
/// # Errors
/// [`Fault::Data`] if a plate is unusable or a frame cannot be decoded; [`Fault::Usage`] if a file cannot be written.
pub(super) fn make(
    store: &Store,
    out: &Path,
    videos: &[RigVideo],
    starts_s: &[f64],
    settings: MatteSettings,
) -> Result<(Vec<CameraMattes>, bool), Fault> {
    let plates = plates::find(videos, settings.plates)?;
    let mut tasks = Vec::new();
    for ((video, start_s), plate) in videos.iter().zip(starts_s).zip(plates) {
        let task = Task::new(out, video, plate, *start_s, settings)?;
        task.check_own(store)?;
        tasks.push(task);
    }
    output::make_folder(&out.join("plates"))?;
    let mut is_kept = true;
    for tasks in tasks.chunks(CAMERAS_MAX) {
        let needed: Vec<&Task> = tasks.iter().filter(|task| !task.is_whole(store)).collect();
        is_kept &= needed.is_empty();
        let files: Vec<(&PlateFile, &RigVideo)> =
            needed.iter().map(|task| (&task.plate, task.video)).collect();
        let plates = plates::make(&files)?;
        needed.par_iter().zip(plates).try_for_each(|(task, plate)| task.make(store, &plate))?;
    }
    let lost = || Fault::Usage(format!("{}: another run changes it; wait for its end", out.display()));
    let mattes = tasks.iter().map(|task| task.kept(store).ok_or_else(lost));
    Ok((mattes.collect::<Result<Vec<CameraMattes>, Fault>>()?, is_kept))
}

impl<'a> Task<'a> {
    fn new(
        out: &'a Path,
        video: &'a RigVideo,
        plate: PlateFile,
        start_s: f64,
        settings: MatteSettings,
    ) -> Result<Task<'a>, Fault> {
        let MatteSettings { policy, frames, fps, .. } = settings;
        let key = json!([
            [identity(&video.path)?, identity(&plate.path)?],
            [start_s, frames, fps],
            [policy == MattePolicy::On, PICTURES_MAX, COMPARED, SIDE]
        ]);
        let at_frames = Video::open(&video.path)?.at_frames(start_s, frames, fps);
        let frames = at_frames.into_iter().map(|at| at.map(|(frame, _)| frame as usize));
        let frames = if policy == MattePolicy::On { frames.collect() } else { Vec::new() };
        let name = format!("mattes-{}", file_name(&video.name));
        Ok(Task { video, plate, frames, out, name, key })
    }

    fn kept(&self, store: &Store) -> Option<CameraMattes> {
        store.kept(&self.name, &self.key)
    }

    fn plate_path(&self) -> PathBuf {
        self.out.join("plates").join(format!("{}.png", self.video.name))
    }

    fn folder(&self) -> PathBuf {
        self.out.join("masks").join(&self.video.name)
    }

    fn mask_path(&self, frame: usize) -> PathBuf {
        self.folder().join(format!("{frame:06}.png"))
    }

    /// Checks that an earlier run made the plate and the masks that are there: this one may replace them.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the first that it did not make.
    fn check_own(&self, store: &Store) -> Result<(), Fault> {
        let has_plate = store.has(&self.name) || store.path(&self.begun("plate")).is_file();
        let has_masks = self.frames.is_empty() || store.path(&self.begun("masks")).is_file();
        let parts = [(self.plate_path(), has_plate), (self.folder(), has_masks)];
        let foreign = parts.into_iter().find(|(path, is_own)| !is_own && path.exists());
        foreign.map_or(Ok(()), |(path, _)| {
            Err(Fault::Usage(format!(
                "{}: it is not from an earlier run of ingest, which would replace it; move it, or name another --out",
                path.display()
            )))
        })
    }

    /// Name of the file that marks the plate or the masks as this command's, from before the first is written.
    fn begun(&self, part: &str) -> String {
        format!("{}.{part}.begun", self.name)
    }

    /// Whether an earlier run made all files with the same key.
    fn is_whole(&self, store: &Store) -> bool {
        let is_there = |(frame, at): (usize, &Option<usize>)| at.is_none() || self.mask_path(frame).is_file();
        self.kept(store).is_some()
            && self.plate_path().is_file()
            && self.frames.iter().enumerate().all(is_there)
    }

    /// Makes what is missing; if the key is another, all.
    fn make(&self, store: &Store, plate: &Plate) -> Result<(), Fault> {
        let (width, height) = self.video.probe.size;
        let opened = Video::open(&self.video.path)?;
        let kept = self.kept(store);
        let mut mattes = match &kept {
            Some(kept) => kept.clone(),
            None => {
                // Until all mattes are made, no run takes mattes of two keys for mattes of one key.
                output::write(&store.path(&self.begun("plate")), b"")?;
                store.forget(&self.name);
                self.compare(&opened, plate)?
            }
        };
        output::write_png(&self.plate_path(), plate.colors().as_flattened(), (width, height))?;
        if !self.frames.is_empty() {
            output::write(&store.path(&self.begun("masks")), b"")?;
            output::make_folder(&self.folder())?;
            self.remove_beyond()?;
        }
        for (frame, at) in self.frames.iter().enumerate() {
            let path = self.mask_path(frame);
            match at {
                Some(_) if kept.is_some() && path.is_file() => {}
                Some(at) => {
                    let alpha = plate.matte(colors(&opened.frame(*at)?));
                    if kept.is_none() {
                        mattes.shares.push(share(&alpha));
                    }
                    write_mask(&path, &alpha, (width, height))?;
                }
                // Another run may have left one.
                None => drop(std::fs::remove_file(path)),
            }
        }
        if kept.is_none() {
            store.keep(&self.name, &self.key, &mattes)?;
        }
        Ok(())
    }

    /// Removes masks of frames beyond the last, which an earlier run of a longer capture left.
    fn remove_beyond(&self) -> Result<(), Fault> {
        let folder = self.folder();
        let entries = std::fs::read_dir(&folder).map_err(|error| unreadable(&folder, &error))?;
        for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
            let frame = path.file_stem().and_then(|stem| stem.to_str()?.parse::<usize>().ok());
            if frame.is_some_and(|frame| frame >= self.frames.len()) {
                output::remove(&path)?;
            }
        }
        Ok(())
    }

    /// Compares the exposure of the plate with the exposure of a few pictures, and shows their mattes.
    fn compare(&self, opened: &Video, plate: &Plate) -> Result<CameraMattes, Fault> {
        let (width, height) = self.video.probe.size;
        let of_plate = RgbImage::from_raw(width, height, plate.colors().as_flattened().to_vec());
        let mut thumbnails = vec![jpeg(&thumbnail(&of_plate.expect("a plate of the video's size"), SIDE))?];
        let in_capture: Vec<usize> = self.frames.iter().flatten().copied().collect();
        let frames = match in_capture.is_empty() {
            true => (0..opened.times_s.len()).collect(),
            false => in_capture,
        };
        let mut gains = Vec::new();
        for i in 0..COMPARED {
            let picture = opened.frame(frames[frames.len() * (2 * i + 1) / (2 * COMPARED)])?;
            gains.push(plate.gains(colors(&picture)));
            if !self.frames.is_empty() {
                let alpha = plate.matte(colors(&picture));
                thumbnails.push(jpeg(&thumbnail(&before_darkness(picture, &alpha), SIDE))?);
            }
        }
        let gains = std::array::from_fn(|c| {
            let mut of_channel: Vec<f64> = gains.iter().map(|gains| gains[c]).collect();
            of_channel.sort_by(f64::total_cmp);
            of_channel[COMPARED / 2]
        });
        let worst =
            gains.into_iter().max_by(|a: &f64, b| a.ln().abs().total_cmp(&b.ln().abs())).unwrap_or(1.0);
        if !self.frames.is_empty() && !(1.0 / GAIN_MAX..=GAIN_MAX).contains(&worst) {
            return Err(bad(
                &self.plate.path,
                format!(
                    "{} is {worst:.2} times as bright as this plate, beyond a factor of {GAIN_MAX}; record the plate with \
                     the exposure of the video",
                    self.video.path.display()
                ),
            ));
        }
        Ok(CameraMattes { source: self.plate.source, gains, shares: Vec::new(), thumbnails })
    }
}

/// Share of the subject.
fn share(alpha: &[u8]) -> f64 {
    alpha.iter().map(|alpha| f64::from(*alpha)).sum::<f64>() / 255.0 / alpha.len().max(1) as f64
}

/// The picture with the background darkened.
fn before_darkness(mut picture: RgbImage, alpha: &[u8]) -> RgbImage {
    for (pixel, alpha) in picture.pixels_mut().zip(alpha) {
        let factor = BEHIND + (1.0 - BEHIND) * f64::from(*alpha) / 255.0;
        pixel.0 = pixel.0.map(|c| (f64::from(c) * factor).round() as u8);
    }
    picture
}

fn write_mask(path: &Path, alpha: &[u8], (width, height): (u32, u32)) -> Result<(), Fault> {
    let mut bytes = Vec::new();
    let encoded = PngEncoder::new(&mut bytes).write_image(alpha, width, height, ExtendedColorType::L8);
    encoded.map_err(|error| Fault::Defect(format!("a mask cannot be encoded: {error}")))?;
    output::write(path, &bytes)
}
