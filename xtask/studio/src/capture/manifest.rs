//! Captures with this project's own manifest, `capture.json`.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::Path;

use refine::capture::{Lens, even_times_s};
use serde::Deserialize;

use super::capture_files::{CaptureBuilder, CaptureFiles, pinhole};
use super::image_file::{bad, bad_layout, read_text};
use super::photo_paths::PhotoPath;
use crate::scene::DEFAULT_FPS;

/// File name of the manifest, which identifies the layout.
pub(super) const FILE: &str = "capture.json";

/// Maximum number of frames: more than an hour at 25 per second.
const FRAMES_MAX: usize = 100_000;

/// Frames per second.
const FPS: RangeInclusive<f64> = 1e-3..=1e6;

/// Skew in pixels up to which it counts as rounding.
const SKEW_MAX: f64 = 1e-6;

/// See `xtask/CAPTURE.md`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    frames: usize,
    fps: Option<f64>,
    #[serde(default)]
    first_frame: usize,
    images: String,
    masks: Option<String>,
    cameras: Vec<ManifestCamera>,
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

pub(super) fn open(folder: &Path) -> anyhow::Result<CaptureFiles> {
    let path = folder.join(FILE);
    let manifest: Manifest =
        serde_json::from_str(&read_text(&path)?).map_err(|error| bad_layout(&path, error))?;
    manifest.check().map_err(|problem| bad_layout(&path, problem))?;
    let fps = manifest.fps.unwrap_or(f64::from(DEFAULT_FPS));
    let mut builder = CaptureBuilder::new(folder);
    for entry in &manifest.cameras {
        let lens =
            entry.lens().map_err(|problem| bad_layout(&path, format!("camera {}: {problem}", entry.id)))?;
        let [[fx, _, cx], [_, fy, cy], _] = entry.k;
        let camera = pinhole((entry.w, entry.h), [fx, fy, cx, cy], entry.w2c);
        let index = builder.camera(&entry.id, camera, lens, entry.held);
        builder.offset_s(index, entry.time_offset_s);
        for frame in 0..manifest.frames {
            let named = |pattern: &String| {
                let named = expand(pattern, &entry.id, manifest.first_frame + frame);
                named.map_err(|problem| bad_layout(&path, problem))
            };
            let image = named(&manifest.images)?;
            if !folder.join(&image).is_file() {
                continue;
            }
            let mask = manifest.masks.as_ref().map(named).transpose()?;
            if let Some(mask) = mask.as_ref().map(|mask| folder.join(mask)).filter(|mask| !mask.is_file()) {
                return Err(bad(
                    &mask,
                    "this mask is missing; put it there, or remove masks from capture.json",
                )
                .into());
            }
            let name = Path::new(&image).with_extension("");
            let name = name.strip_prefix("images").unwrap_or(&name).to_string_lossy();
            builder.photo(index, frame, PhotoPath { image: &image, name: &name, mask: mask.as_deref() });
        }
    }
    Ok(builder.build(even_times_s(manifest.frames, fps), manifest.fps))
}

impl Manifest {
    /// Checks the values that no photograph depends on alone.
    fn check(&self) -> Result<(), String> {
        let Manifest { frames, fps, first_frame, images, cameras, .. } = self;
        if !(1..=FRAMES_MAX).contains(frames) {
            return Err(format!("{frames} frames: the range is 1 to {FRAMES_MAX}"));
        }
        if first_frame.checked_add(*frames).is_none() {
            return Err(format!("first_frame {first_frame} is too large"));
        }
        if let Some(fps) = fps.filter(|fps| !FPS.contains(fps)) {
            return Err(format!("fps {fps}: the range is {} to {}", FPS.start(), FPS.end()));
        }
        let duration_s = (*frames - 1) as f64 / fps.unwrap_or(f64::INFINITY);
        let mut names = BTreeSet::new();
        for ManifestCamera { id, k, time_offset_s, .. } in cameras {
            if *time_offset_s != 0.0 && fps.is_none() {
                return Err(format!("camera {id} has a time_offset_s, so the capture needs its fps"));
            }
            if time_offset_s.abs() > duration_s {
                return Err(format!(
                    "camera {id}: time_offset_s {time_offset_s} is longer than the clip, {duration_s} s; it counts seconds"
                ));
            }
            if !names.insert(id) {
                return Err(format!("camera {id} is listed twice"));
            }
            if k[0][1].abs() > SKEW_MAX {
                return Err(format!("camera {id}: K has a skew of {}, which is not supported", k[0][1]));
            }
        }
        // Without the placeholder, all cameras or frames would share one file.
        let needs = |placeholder: &str, many: bool| many && !images.contains(&format!("{{{placeholder}"));
        match [("camera", cameras.len() > 1), ("frame", *frames > 1)]
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
    }
    path.push_str(rest);
    Ok(path)
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
    }
}
