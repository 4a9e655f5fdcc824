//! Writes the capture: a manifest that refers to the videos, or their frames as pictures.

use std::path::{Component, Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use program::{Fault, output};
use rayon::prelude::*;
use serde_json::json;

use super::calibration::RigCamera;
use super::mattes::{MASKS, PLATES};
use super::options::ExtractFormat;
use super::placement::Placement;
use super::starts::{StartSource, Starts};
use super::store::{Store, file_name, identity};
use super::videos::RigVideo;
use crate::capture::{Video, bad};

/// File name of the manifest.
pub(super) const MANIFEST: &str = "capture.json";

/// Quality of JPEG pictures.
const QUALITY: u8 = 95;

/// What the manifest says of frames and cameras.
pub(super) struct CaptureParts<'c> {
    pub(super) videos: &'c [RigVideo],
    pub(super) cameras: &'c [RigCamera],
    pub(super) starts: &'c Starts,
    pub(super) fps: f64,
    pub(super) frames: usize,
    /// Whether there are masks.
    pub(super) has_masks: bool,
}

/// Number of frames from the start of the last video to the end of the first that ends.
pub(super) fn frames(videos: &[RigVideo], starts: &Starts, fps: f64) -> usize {
    let ends_s = videos.iter().zip(&starts.starts_s).map(|(video, start_s)| start_s + video.probe.duration_s);
    // The last frame may be as late as rounding.
    (ends_s.fold(f64::INFINITY, f64::min) * fps + 1e-3) as usize + 1
}

/// Writes the manifest in the folder `out`, and before it pictures where they are asked for.
///
/// # Errors
/// [`Fault::Usage`] if something cannot be written; [`Fault::Data`] if a frame cannot be decoded.
pub(super) fn write(
    store: &Store,
    out: &Path,
    parts: &CaptureParts,
    placement: &Placement,
    extract: Option<ExtractFormat>,
) -> Result<(), Fault> {
    let late_s = match extract {
        Some(format) => extracted(store, out, parts, format)?,
        None => vec![0.0; parts.videos.len()],
    };
    let mut cameras = Vec::new();
    for (i, late_s) in late_s.into_iter().enumerate() {
        cameras.push(format!("    {}", camera(out, parts, i, extract.is_some(), late_s)?));
    }
    // What a fit learns: sound and timecodes are not exact, and no two cameras show the same colours.
    let learn: &[&str] = match parts.starts.source {
        StartSource::Together => &["colors"],
        _ => &["offsets", "colors"],
    };
    let mut head =
        vec![("fps", json!(parts.fps)), ("frames", json!(parts.frames)), ("up", json!(placement.up))];
    if let Some(metres) = placement.metres_per_unit {
        head.push(("metres_per_unit", json!(metres)));
    }
    if let Some(format) = extract {
        head.push(("images", json!(format!("images/{{camera}}/{{frame:06}}.{}", format.extension()))));
    }
    if parts.has_masks {
        head.push(("masks", json!(MASKS)));
    }
    head.push(("plates", json!(PLATES)));
    if let Some(i) = parts.starts.sound_of(parts.videos) {
        let video = &parts.videos[i];
        // A file may begin before its first frame.
        let start_s = parts.starts.starts_s[i] - video.probe.first_s;
        head.push(("sound", json!({"file": path_from(out, &video.path)?, "start_s": start_s})));
    }
    if parts.videos.len() > 1 {
        head.push(("learn", json!(learn)));
    }
    let head: String = head.iter().map(|(key, value)| format!("  \"{key}\": {value},\n")).collect();
    let text = format!("{{\n{head}  \"cameras\": [\n{}\n  ]\n}}\n", cameras.join(",\n"));
    output::write(&out.join(MANIFEST), text.as_bytes())
}

/// Whether the manifest at `path` is the manifest `before`, but for the size of a unit.
pub(super) fn is_same_but_for_size(before: &str, path: &Path) -> bool {
    let is_other = |line: &&str| !line.contains("\"metres_per_unit\"");
    let is_same = |now: &str| now.lines().filter(is_other).eq(before.lines().filter(is_other));
    std::fs::read_to_string(path).is_ok_and(|now| is_same(&now))
}

fn camera(
    out: &Path,
    parts: &CaptureParts,
    i: usize,
    is_extracted: bool,
    late_s: f64,
) -> Result<String, Fault> {
    let (video, RigCamera { camera, lens, .. }) = (&parts.videos[i], &parts.cameras[i]);
    let (is_fisheye, coefficients) = lens.coefficients();
    let mut keys = vec![("id", json!(video.name)), ("w", json!(camera.width)), ("h", json!(camera.height))];
    if is_extracted {
        if late_s != 0.0 {
            keys.push(("time_offset_s", json!(late_s)));
        }
    } else {
        keys.push(("video", json!(path_from(out, &video.path)?)));
        keys.push(("start_s", json!(parts.starts.starts_s[i])));
    }
    keys.push(("K", json!(camera.k)));
    if is_fisheye {
        keys.push(("lens", json!("fisheye")));
    }
    if is_fisheye || !lens.is_none() {
        keys.push(("D", json!(coefficients)));
    }
    keys.push(("w2c", json!(camera.camera_from_world)));
    let keys: Vec<String> = keys.iter().map(|(key, value)| format!("\"{key}\": {value}")).collect();
    Ok(format!("{{{}}}", keys.join(", ")))
}

/// The path of a video for a manifest in `folder`: relative if the two share more than the root.
fn path_from(folder: &Path, video: &Path) -> Result<String, Fault> {
    let absolute = |path: &Path| {
        std::fs::canonicalize(path).map_err(|error| Fault::Usage(format!("{}: {error}", path.display())))
    };
    let (folder, video) = (absolute(folder)?, absolute(video)?);
    let path = relative(&folder, &video).unwrap_or_else(|| video.clone());
    path.to_str().map(str::to_owned).ok_or_else(|| bad(&video, "its path is not UTF-8; rename it"))
}

/// The path from a folder to a file, both absolute; `None` if they share nothing but the root.
fn relative(folder: &Path, file: &Path) -> Option<PathBuf> {
    let shared = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let is_name = |component: &Component| matches!(component, Component::Normal(_));
    folder.components().take(shared).any(|component| is_name(&component)).then(|| {
        let up = folder.components().skip(shared).map(|_| Component::ParentDir);
        up.chain(file.components().skip(shared)).collect()
    })
}

/// Writes the frames of all videos, and returns the seconds by which each camera's are late, in the middle.
fn extracted(
    store: &Store,
    out: &Path,
    parts: &CaptureParts,
    format: ExtractFormat,
) -> Result<Vec<f64>, Fault> {
    let write_video = |(video, start_s): (&RigVideo, &f64)| {
        let opened = Video::open(&video.path)?;
        let at_frames = opened.at_frames(*start_s, parts.frames, parts.fps);
        let folder = out.join("images").join(&video.name);
        output::make_folder(&folder)?;
        let key =
            json!([identity(&video.path)?, start_s, parts.frames, parts.fps, format.extension(), QUALITY]);
        // A picture that is missing is made again: only whole ones have their names.
        let path = |frame: usize| folder.join(format!("{frame:06}.{}", format.extension()));
        let make = || {
            for (frame, at) in at_frames.iter().enumerate() {
                match at {
                    Some((number, _)) => {
                        write_picture(&path(frame), &opened.frame(*number as usize)?, format)?
                    }
                    // Another extraction may have left one.
                    None => drop(std::fs::remove_file(path(frame))),
                }
            }
            Ok(true)
        };
        let (_, is_kept) = store.result(&format!("extracted-{}", file_name(&video.name)), &key, make)?;
        let is_there = |(frame, at): (usize, &Option<_>)| at.is_none() || path(frame).is_file();
        if is_kept && !at_frames.iter().enumerate().all(is_there) {
            make()?;
        }
        let mut late_s: Vec<f64> = at_frames.iter().flatten().map(|(_, late_s)| *late_s).collect();
        late_s.sort_by(f64::total_cmp);
        Ok(late_s.get(late_s.len() / 2).copied().unwrap_or(0.0))
    };
    parts.videos.par_iter().zip(&parts.starts.starts_s).map(write_video).collect()
}

fn write_picture(path: &Path, picture: &image::RgbImage, format: ExtractFormat) -> Result<(), Fault> {
    let mut bytes = Vec::new();
    let encoded = match format {
        ExtractFormat::Jpeg => JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(picture),
        ExtractFormat::Png => picture.write_with_encoder(PngEncoder::new(&mut bytes)),
    };
    encoded.map_err(|error| Fault::Defect(format!("a picture cannot be encoded: {error}")))?;
    output::write(path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_below_a_common_folder() {
        let relative_path = |folder: &str, file: &str| relative(Path::new(folder), Path::new(file));
        assert_eq!(relative_path("/a/out", "/a/rig/c.mp4"), Some("../rig/c.mp4".into()));
        assert_eq!(relative_path("/a/rig", "/a/rig/c.mp4"), Some("c.mp4".into()));
        assert_eq!(relative_path("/home/x/out", "/mnt/c.mp4"), None);
    }
}
