//! Decodes a few frames of each video: thumbnails for the page, corners for the check of the calibration.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{RgbImage, imageops};
use program::Fault;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::features::Features;
use super::store::{Store, file_name, identity};
use super::videos::RigVideo;
use crate::capture::Video;

/// Frames of a contact sheet, evenly over the capture.
pub(super) const FRAMES: usize = 5;

/// Those of them in which corners are sought: at the start, in the middle, at the end.
pub(super) const CHECKED: [usize; 3] = [0, 2, 4];

/// Longest side of a thumbnail in pixels, and its quality.
const SIDE: u32 = 256;
const QUALITY: u8 = 80;

/// Frames of a video.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Pictures {
    /// JPEG in base64.
    pub(super) thumbnails: Vec<String>,
    /// Mean colour of each, from 0 to 255.
    pub(super) means: Vec<[f64; 3]>,
    /// Corners of the [`CHECKED`] ones.
    pub(super) features: Vec<Features>,
}

/// Instants of the frames in a capture of this many seconds.
pub(super) fn instants_s(duration_s: f64) -> [f64; FRAMES] {
    std::array::from_fn(|i| duration_s * i as f64 / (FRAMES - 1) as f64)
}

/// Decodes the frames of a video that starts at `start_s` nearest to `instants_s`, unless an earlier run did, which the
/// flag says.
///
/// # Errors
/// [`Fault::Data`] if ffmpeg cannot decode one of them.
pub(super) fn decode(
    store: &Store,
    video: &RigVideo,
    start_s: f64,
    instants_s: &[f64; FRAMES],
) -> Result<(Pictures, bool), Fault> {
    let frames = instants_s.map(|instant_s| nearest(&video.probe.times_s, instant_s - start_s));
    let key = json!([identity(&video.path)?, frames, SIDE, QUALITY]);
    store.result(&format!("pictures-{}", file_name(&video.name)), &key, || {
        let opened = Video::open(&video.path)?;
        let mut pictures = Pictures { thumbnails: Vec::new(), means: Vec::new(), features: Vec::new() };
        for (i, frame) in frames.iter().enumerate() {
            let picture = opened.frame(*frame)?;
            let thumbnail = thumbnail(&picture, SIDE);
            pictures.thumbnails.push(jpeg(&thumbnail)?);
            let pixels = f64::from(thumbnail.width()) * f64::from(thumbnail.height());
            let mean = |c: usize| thumbnail.pixels().map(|p| f64::from(p.0[c])).sum::<f64>() / pixels;
            pictures.means.push([mean(0), mean(1), mean(2)]);
            if CHECKED.contains(&i) {
                pictures.features.push(Features::detect(&picture));
            }
        }
        Ok(pictures)
    })
}

/// A picture of at most `side` pixels on its longer side.
pub(super) fn thumbnail(picture: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = picture.dimensions();
    let factor = (f64::from(side) / f64::from(width.max(height))).min(1.0);
    let [w, h] = [width, height].map(|side| ((f64::from(side) * factor) as u32).max(1));
    imageops::thumbnail(picture, w, h)
}

/// A picture as JPEG in base64.
pub(super) fn jpeg(picture: &RgbImage) -> Result<String, Fault> {
    let mut jpeg = Vec::new();
    let encoded = JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(picture);
    encoded.map_err(|error| Fault::Defect(format!("a thumbnail cannot be encoded: {error}")))?;
    Ok(STANDARD.encode(jpeg))
}

/// Number of the time that is nearest.
fn nearest(times_s: &[f64], time_s: f64) -> usize {
    let after = times_s.partition_point(|time| *time < time_s);
    let candidates = [after.saturating_sub(1), after.min(times_s.len() - 1)];
    let off = |i: &usize| (times_s[*i] - time_s).abs();
    candidates.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).expect("two")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_frame_is_found() {
        let times_s = [0.0, 0.1, 0.3];
        let found = [-1.0, 0.04, 0.06, 0.21, 9.0].map(|time_s| nearest(&times_s, time_s));
        assert_eq!(found, [0, 0, 1, 2, 2]);
        assert_eq!(instants_s(2.0), [0.0, 0.5, 1.0, 1.5, 2.0]);
    }
}
