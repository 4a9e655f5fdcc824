//! Finds the camera of each video by name, and compares the sizes of both.
//!
//! Names match if they are equal, or if one is a part of the other; case and punctuation do not count, and a number is
//! whole: `cam1` is no part of `cam10`.

use std::path::Path;

use codec::Camera;
use program::Fault;

use super::calibration::{Calibration, RigCamera};
use super::options::ResizePolicy;
use super::videos::RigVideo;
use crate::capture::bad;

/// The camera of each video, in their order.
///
/// # Errors
/// [`Fault::Data`] if a video has no camera or several, or a camera no video or several.
pub(super) fn cameras_of(videos: &[RigVideo], calibration: &Calibration) -> Result<Vec<RigCamera>, Fault> {
    let path = &calibration.path;
    let mut video_of: Vec<Option<usize>> = vec![None; calibration.cameras.len()];
    let mut cameras = Vec::new();
    for (v, video) in videos.iter().enumerate() {
        let c = camera_of(video, calibration)?;
        if let Some(other) = video_of[c].replace(v) {
            return Err(bad(
                &video.path,
                format!(
                    "{} is of the same camera, {}; leave one of the two files there",
                    file_name(&videos[other].path),
                    calibration.cameras[c].name
                ),
            ));
        }
        cameras.push(calibration.cameras[c].clone());
    }
    match video_of.iter().position(Option::is_none) {
        Some(c) => Err(bad(
            path,
            format!(
                "camera {} has no video; put it there under that name, or remove the camera from the calibration",
                calibration.cameras[c].name
            ),
        )),
        None => Ok(cameras),
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn camera_of(video: &RigVideo, calibration: &Calibration) -> Result<usize, Fault> {
    let names: Vec<&str> = calibration.cameras.iter().map(|camera| camera.name.as_str()).collect();
    match named(&video.name, &names)[..] {
        [camera] => Ok(camera),
        [a, b, ..] => Err(bad(
            &video.path,
            format!("its name fits the cameras {} and {}; rename it to that of one", names[a], names[b]),
        )),
        [] => Err(bad(
            &video.path,
            format!(
                "{} has no camera of that name; rename it to one of {}, or take it away",
                calibration.path.display(),
                names[..names.len().min(12)].join(", ")
            ),
        )),
    }
}

/// Numbers of the names that match `name` in the surest way in which any does.
pub(super) fn named(name: &str, names: &[&str]) -> Vec<usize> {
    // From the surest way to the least.
    let ways: [fn(&str, &str) -> bool; 3] = [
        |a, b| a == b,
        |a, b| plain(a) == plain(b) && !plain(a).is_empty(),
        |a, b| is_part(&plain(a), &plain(b)) || is_part(&plain(b), &plain(a)),
    ];
    let found = |way: fn(&str, &str) -> bool| -> Vec<usize> {
        (0..names.len()).filter(|i| way(name, names[*i])).collect()
    };
    ways.into_iter().map(found).find(|found| !found.is_empty()).unwrap_or_default()
}

/// A name without punctuation, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Whether `part` is in `whole` without cutting a number.
fn is_part(part: &str, whole: &str) -> bool {
    let cuts = |outside: Option<char>, inside: Option<char>| {
        [outside, inside].iter().all(|c| c.is_some_and(|c| c.is_ascii_digit()))
    };
    !part.is_empty()
        && whole.match_indices(part).any(|(at, _)| {
            let (before, after) = (&whole[..at], &whole[at + part.len()..]);
            !cuts(before.chars().next_back(), part.chars().next())
                && !cuts(after.chars().next(), part.chars().next_back())
        })
}

/// The camera with the size of its video.
///
/// # Errors
/// [`Fault::Data`] that says how the sizes differ, and what helps.
pub(super) fn sized(
    video: &RigVideo,
    camera: &Camera,
    resize: Option<ResizePolicy>,
) -> Result<Camera, Fault> {
    let ((width, height), (w, h)) = (video.probe.size, (camera.width, camera.height));
    if (width, height) == (w, h) || (w, h) == (0, 0) {
        return Ok(Camera { width, height, ..camera.clone() });
    }
    let mut resized = Camera { width, height, ..camera.clone() };
    let factors = [f64::from(width) / f64::from(w), f64::from(height) / f64::from(h)];
    match resize {
        Some(ResizePolicy::Scale) => {
            (0..2).for_each(|axis| resized.k[axis].iter_mut().for_each(|k| *k *= factors[axis]));
            return Ok(resized);
        }
        Some(ResizePolicy::Crop) => {
            let more = [f64::from(width) - f64::from(w), f64::from(height) - f64::from(h)];
            (0..2).for_each(|axis| resized.k[axis][2] += 0.5 * more[axis]);
            return Ok(resized);
        }
        None => {}
    }
    let proportions = factors[0] / factors[1];
    let why = if (height, width) == (w, h) {
        "it is rotated, or the calibration is; turn the video by its metadata, or calibrate with turned pictures"
            .to_owned()
    } else if width != w && height != h && (proportions - 1.0).abs() < 2.0 / f64::from(width.min(height)) {
        format!("it is scaled by {:.3}; --resize scale scales the camera, too", factors[0])
    } else {
        "other proportions; --resize scale if the pictures were scaled, --resize crop if as much was cut off (or added) on \
         both sides"
            .to_owned()
    };
    Err(bad(&video.path, format!("{width}x{height} pixels, but its calibration is of {w}x{h}: {why}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parts_without_cutting_numbers() {
        for (part, whole) in [("cam01", "intcam01img"), ("1", "cam1"), ("a", "cama"), ("cam1", "cam1left")] {
            assert!(is_part(part, whole), "{part} in {whole}");
        }
        for (part, whole) in [("cam1", "cam10"), ("1", "cam01"), ("1", "cam21"), ("", "a"), ("b", "a")] {
            assert!(!is_part(part, whole), "{part} in {whole}");
        }
        assert_eq!(plain("Cam_01 (left)"), "cam01left");
    }
}
