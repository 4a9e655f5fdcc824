//! Captures with this project's own manifest, `capture.json`.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::Path;

use program::Fault;
use refine::capture::{Lens, even_times_s};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::camera_part::CameraPart;
use super::camera_plate::CameraPlate;
use super::capture_files::{CaptureBuilder, CaptureFiles, CaptureSound, intrinsics, pinhole};
use super::image_file::{bad, bad_layout, read_text};
use super::photo_paths::PhotoPath;
use super::video::Video;
use crate::scene::DEFAULT_FPS;

/// File name of the manifest, which identifies the layout.
pub(super) const FILE: &str = "capture.json";

/// Maximum number of frames: more than an hour at 25 per second.
const FRAMES_MAX: usize = 100_000;

/// Frames per second.
const FPS: RangeInclusive<f64> = 1e-3..=1e6;

/// Metres per unit of length.
const METRES_PER_UNIT: RangeInclusive<f64> = 1e-9..=1e9;

/// Most bytes of a path, as on Linux: a pattern may name a camera many times.
const PATH_MAX: usize = 4096;

/// See `xtask/CAPTURE.md`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    frames: Option<usize>,
    fps: Option<f64>,
    #[serde(default)]
    first_frame: usize,
    images: Option<String>,
    masks: Option<String>,
    plates: Option<String>,
    #[serde(default)]
    learn: Vec<CameraPart>,
    up: Option<[f64; 3]>,
    metres_per_unit: Option<f64>,
    sound: Option<ManifestSound>,
    cameras: Vec<ManifestCamera>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ManifestSound {
    file: String,
    #[serde(default)]
    start_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ManifestCamera {
    id: String,
    w: u32,
    h: u32,
    #[serde(rename = "K")]
    k: [[f64; 3]; 3],
    #[serde(rename = "D", default)]
    d: Vec<f64>,
    #[serde(default)]
    lens: LensModel,
    w2c: [[f64; 4]; 4],
    video: Option<String>,
    #[serde(default)]
    start_s: f64,
    #[serde(default)]
    time_offset_s: f64,
    #[serde(default)]
    held: bool,
}

/// The model whose coefficients `D` lists.
#[derive(Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum LensModel {
    #[default]
    Rational,
    Fisheye,
}

impl ManifestSound {
    fn in_folder(self, folder: &Path) -> CaptureSound {
        CaptureSound { path: folder.join(self.file), start_s: self.start_s }
    }
}

pub(super) fn open(folder: &Path) -> anyhow::Result<CaptureFiles> {
    let path = folder.join(FILE);
    let bad_manifest = |problem: String| bad_layout(&path, problem);
    let manifest = parse(&read_text(&path)?).map_err(bad_manifest)?;
    manifest.check().map_err(bad_manifest)?;
    let fps = manifest.fps.unwrap_or(f64::from(DEFAULT_FPS));
    let mut builder = CaptureBuilder::new(folder);
    let videos = open_videos(&manifest, folder, &mut builder)?;
    let frames = manifest.frames_of(&videos, fps).map_err(bad_manifest)?;
    manifest.check_frames(frames).map_err(bad_manifest)?;
    for (entry, video) in manifest.cameras.iter().zip(videos) {
        let lens =
            entry.lens().map_err(|problem| bad_layout(&path, format!("camera {}: {problem}", entry.id)))?;
        let [[fx, _, cx], [_, fy, cy], _] = entry.k;
        let camera = pinhole((entry.w, entry.h), [fx, fy, cx, cy], entry.w2c);
        let index = builder.camera(&entry.id, camera, lens, entry.held);
        builder.offset_s(index, entry.time_offset_s);
        if let Some(plate) = plate_of(&manifest, entry, folder, &path)? {
            builder.plate(index, plate);
        }
        let named = |pattern: &String, frame: usize| {
            expand(pattern, &entry.id, manifest.first_frame + frame).map_err(bad_manifest)
        };
        let mask_of = |frame: usize| -> Result<Option<String>, Fault> {
            let Some(pattern) = &manifest.masks else { return Ok(None) };
            let mask = named(pattern, frame)?;
            let file = folder.join(&mask);
            let missing = "this mask is missing; put it there, or remove masks from capture.json";
            if file.is_file() { Ok(Some(mask)) } else { Err(bad(&file, missing)) }
        };
        if let Some(video) = video {
            let at_frames = video.at_frames(entry.start_s, frames, fps);
            builder.video(index, video, &at_frames, mask_of)?;
            continue;
        }
        let pattern = manifest.images.as_ref().expect("cameras without a video have images");
        for frame in 0..frames {
            let image = named(pattern, frame)?;
            if !folder.join(&image).is_file() {
                continue;
            }
            let mask = mask_of(frame)?;
            let name = Path::new(&image).with_extension("");
            let name = name.strip_prefix("images").unwrap_or(&name).to_string_lossy();
            builder.photo(index, frame, PhotoPath { image: &image, name: &name, mask: mask.as_deref() })?;
        }
    }
    let learned = CameraPart::learned(&manifest.learn);
    Ok(CaptureFiles {
        learned,
        stated_up: manifest.up.map(unit),
        metres_per_unit: manifest.metres_per_unit,
        sound: manifest.sound.map(|sound| sound.in_folder(folder)),
        ..builder.build(even_times_s(frames, fps), manifest.fps)
    })
}

fn parse(text: &str) -> Result<Manifest, String> {
    serde_json::from_str(text)
        .map_err(|error| about_entry::<ManifestCamera>(text, &error, "cameras", "camera", "id"))
}

/// What is wrong in a JSON file, and with which of the entries `T` of its `list`, if it is with one: a `noun` and its value
/// of `key`, or its number from 1.
pub(super) fn about_entry<T: DeserializeOwned>(
    text: &str,
    error: &serde_json::Error,
    list: &str,
    noun: &str,
    key: &str,
) -> String {
    let file: Value = serde_json::from_str(text).unwrap_or_default();
    let mut entries = (1..).zip(file[list].as_array().into_iter().flatten());
    match entries.find(|(_, entry)| T::deserialize(*entry).is_err()) {
        Some((number, entry)) => {
            let name = entry[key].as_str().map_or_else(|| format!("number {number}"), str::to_owned);
            format!("{noun} {name}: {error}")
        }
        None => error.to_string(),
    }
}

/// The plate of a camera, a file in `folder`; the manifest is at `path`.
fn plate_of(
    manifest: &Manifest,
    entry: &ManifestCamera,
    folder: &Path,
    path: &Path,
) -> Result<Option<CameraPlate>, Fault> {
    let Some(pattern) = &manifest.plates else { return Ok(None) };
    let plate = expand(pattern, &entry.id, 0).map_err(|problem| bad_layout(path, problem))?;
    CameraPlate::stated(folder.join(plate)).map(Some)
}

/// The direction of a vector, with length 1.
pub(super) fn unit(vector: [f64; 3]) -> [f64; 3] {
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    vector.map(|x| x / length)
}

/// Opens the videos of the cameras that have one.
fn open_videos(
    manifest: &Manifest,
    folder: &Path,
    builder: &mut CaptureBuilder,
) -> Result<Vec<Option<Video>>, Fault> {
    let mut videos = Vec::new();
    for entry in &manifest.cameras {
        let video = entry.video.as_ref().map(|video| open_video(&folder.join(video), entry)).transpose()?;
        builder.spend(video.as_ref().map_or(0, |video| size_of_val(&*video.times_s) as u64))?;
        videos.push(video);
    }
    Ok(videos)
}

/// Opens the video of a camera.
fn open_video(path: &Path, entry: &ManifestCamera) -> Result<Video, Fault> {
    let video = Video::open(path)?;
    let ((width, height), (w, h)) = (video.size, (entry.w, entry.h));
    if (width, height) == (w, h) {
        return Ok(video);
    }
    let why = if (height, width) == (w, h) { "it is turned, or its camera is; " } else { "" };
    Err(bad(
        path,
        format!(
            "{width}x{height} pixels, but its camera has {w}x{h}: {why}scale the video, or correct the camera"
        ),
    ))
}

/// Checks a number of frames per second.
///
/// # Errors
/// A sentence that names the range.
pub(crate) fn check_fps(fps: f64) -> Result<(), String> {
    match FPS.contains(&fps) {
        true => Ok(()),
        false => Err(format!("fps {fps}: the range is {} to {}", FPS.start(), FPS.end())),
    }
}

/// Checks a number of frames.
///
/// # Errors
/// A sentence that names the range.
pub(crate) fn check_length(frames: usize) -> Result<(), String> {
    match (1..=FRAMES_MAX).contains(&frames) {
        true => Ok(()),
        false => Err(format!("{frames} frames: the range is 1 to {FRAMES_MAX}")),
    }
}

impl Manifest {
    /// Checks the values that no photograph depends on alone.
    fn check(&self) -> Result<(), String> {
        let Manifest { fps, images, plates, up, metres_per_unit, cameras, .. } = self;
        fps.map_or(Ok(()), check_fps)?;
        if let Some(metres) = metres_per_unit.filter(|metres| !METRES_PER_UNIT.contains(metres)) {
            let (low, high) = (METRES_PER_UNIT.start(), METRES_PER_UNIT.end());
            return Err(format!("metres_per_unit {metres}: the range is {low:e} to {high:e}"));
        }
        if let Some(up) = up.filter(|up| !unit(*up).iter().all(|x| x.is_finite())) {
            return Err(format!("up {up:?} is no direction"));
        }
        if let Some(plates) = plates {
            if plates.contains("{frame") {
                return Err(format!("plates \"{plates}\" has a {{frame}}, but a camera has one plate"));
            }
            if cameras.len() > 1 && !plates.contains("{camera}") {
                return Err(format!("plates \"{plates}\" has no {{camera}}: all would share one plate"));
            }
        }
        let mut names = BTreeSet::new();
        for ManifestCamera { id, k, time_offset_s, video, start_s, .. } in cameras {
            if *time_offset_s != 0.0 && fps.is_none() {
                return Err(format!("camera {id} has a time_offset_s, so the capture needs its fps"));
            }
            if video.is_some() && fps.is_none() {
                return Err(format!("camera {id} has a video, so the capture needs its fps"));
            }
            if video.is_none() && images.is_none() {
                return Err(format!("camera {id} has no video, so the capture needs its images"));
            }
            if video.is_none() && *start_s != 0.0 {
                return Err(format!("camera {id} has a start_s, which is of videos; name its video"));
            }
            if !names.insert(id) {
                return Err(format!("camera {id} is listed twice"));
            }
            intrinsics(k.as_flattened()).map_err(|problem| format!("camera {id}: {problem}"))?;
        }
        Ok(())
    }

    /// Number of frames, stated or as far as all videos go.
    fn frames_of(&self, videos: &[Option<Video>], fps: f64) -> Result<usize, String> {
        if let Some(frames) = self.frames {
            return Ok(frames);
        }
        let end_s = |(entry, video): (&ManifestCamera, &Option<Video>)| match video {
            Some(video) => Ok(entry.start_s + video.times_s.last().copied().unwrap_or(0.0)),
            None => Err(format!("camera {} has no video, so the capture needs its frames", entry.id)),
        };
        let ends_s = self.cameras.iter().zip(videos).map(end_s).collect::<Result<Vec<f64>, String>>()?;
        let end_s = ends_s.into_iter().fold(f64::INFINITY, f64::min);
        if end_s < 0.0 {
            return Err(format!(
                "a video ends {:.3} s before the capture begins; correct its start_s",
                -end_s
            ));
        }
        // The last frame may be as late as rounding.
        Ok(((end_s * fps + 1e-3) as usize).saturating_add(1))
    }

    /// Checks the number of frames, and what depends on it.
    fn check_frames(&self, frames: usize) -> Result<(), String> {
        let Manifest { fps, first_frame, images, cameras, .. } = self;
        check_length(frames)?;
        if first_frame.checked_add(frames).is_none() {
            return Err(format!("first_frame {first_frame} is too large"));
        }
        let duration_s = (frames - 1) as f64 / fps.unwrap_or(f64::INFINITY);
        for ManifestCamera { id, time_offset_s, .. } in cameras {
            if time_offset_s.abs() > duration_s {
                return Err(format!(
                    "camera {id}: time_offset_s {time_offset_s} is longer than the clip, {duration_s} s; it counts seconds"
                ));
            }
        }
        let Some(images) = images else { return Ok(()) };
        // Without the placeholder, all cameras or frames would share one file.
        let needs = |placeholder: &str, many: bool| many && !images.contains(&format!("{{{placeholder}"));
        match [("camera", cameras.len() > 1), ("frame", frames > 1)]
            .iter()
            .find(|(placeholder, many)| needs(placeholder, *many))
        {
            Some((placeholder, _)) if expand(images, "", 0).is_ok() => {
                Err(format!("images \"{images}\" has no {{{placeholder}}}: all would share one photograph"))
            }
            _ => Ok(()),
        }
    }
}

impl ManifestCamera {
    fn lens(&self) -> Result<Lens, String> {
        match self.lens {
            LensModel::Rational => Lens::rational(&self.d),
            LensModel::Fisheye => Lens::fisheye(&self.d),
        }
    }
}

/// Replaces `{camera}` and `{frame}` in a path; `{frame:06}` pads with zeros.
fn expand(pattern: &str, camera: &str, frame: usize) -> Result<String, String> {
    let mut path = String::new();
    let mut rest = pattern;
    while let Some((before, after)) = rest.split_once('{') {
        let (name, after) = after.split_once('}').ok_or_else(|| format!("\"{pattern}\": a brace is open"))?;
        path.push_str(before);
        match name.split_once(':') {
            None if name == "camera" => path.push_str(camera),
            None if name == "frame" => path.push_str(&frame.to_string()),
            Some(("frame", width)) => {
                let width: usize = width
                    .parse()
                    .ok()
                    .filter(|width| *width <= 20)
                    .ok_or_else(|| format!("\"{pattern}\": {{frame:{width}}} is no number of digits"))?;
                path.push_str(&format!("{frame:0width$}"));
            }
            _ => return Err(format!("\"{pattern}\": {{{name}}} is neither {{camera}} nor {{frame}}")),
        }
        rest = after;
        if path.len() > PATH_MAX {
            break;
        }
    }
    path.push_str(rest);
    match path.len() > PATH_MAX {
        true => Err(format!("a path of {camera:.20} has more than {PATH_MAX} bytes")),
        false => Ok(path),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_filled_in() {
        assert_eq!(expand("images/{camera}/{frame:06}.png", "07", 12).unwrap(), "images/07/000012.png");
        assert_eq!(expand("{frame}", "a", 3).unwrap(), "3");
        for wrong in ["{", "{x}", "{frame:x}", "{frame:99}", "{camera:3}"] {
            assert!(expand(wrong, "a", 0).is_err(), "{wrong}");
        }
        // A terabyte.
        let error = expand(&"{camera}".repeat(1 << 20), &"c".repeat(1 << 20), 0).unwrap_err();
        assert!(error.contains("more than 4096 bytes") && error.len() < 100, "{error}");
    }
}
