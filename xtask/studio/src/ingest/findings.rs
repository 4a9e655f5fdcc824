//! [`IngestFindings`]: what the steps found, and what of it deserves a warning.

use refine::matte::GAIN_MAX;
use refine::metrics::median;
use serde::Serialize;

use super::calibration::RigCamera;
use super::epipolar::{EpipolarCheck, MOVED_PX};
use super::mattes::CameraMattes;
use super::placement::Placement;
use super::plates::PlateSource;
use super::sound::{CONFIDENCE_MIN, DRIFT_MAX_PPM};
use super::starts::{StartSource, Starts};
use super::videos::{Probe, RigVideo};
use crate::capture::PICTURES_MAX;
use crate::messages::{count, decimal};

/// Median distance from epipolar lines in pixels, of pictures of 1000, from which on a calibration deserves a warning.
const EPIPOLAR_MAX_PX: f64 = 3.0;

/// Part of a frame by which drift may move a camera before it deserves a warning.
const DRIFT_FRAMES: f64 = 0.1;

/// Mean shares of the subject below and above which mattes deserve a warning.
const SHARES: [f64; 2] = [0.001, 0.4];

/// Difference between a plate's and its video's exposure that deserves a warning: half a third of a stop.
const GAIN_NOTED: f64 = 0.12;

/// What the steps found.
#[derive(Clone, Debug, Serialize)]
pub struct IngestFindings {
    /// Folder of the videos.
    pub rig: String,
    /// Path of the calibration.
    pub calibration: String,
    /// Its layout.
    pub layout: String,
    /// Frames per second of the capture.
    pub fps: f64,
    /// Number of its frames.
    pub frames: usize,
    /// The cameras, in the order of their videos.
    pub cameras: Vec<CameraFindings>,
    /// When they start.
    pub starts: Starts,
    /// Where they are.
    pub placement: Placement,
    /// The calibration against pictures.
    pub epipolar: EpipolarCheck,
    /// The mattes of each camera, in their order.
    pub mattes: Vec<CameraMattes>,
    /// What should be looked at, in sentences.
    pub warnings: Vec<String>,
}

/// A camera and its video.
#[derive(Clone, Debug, Serialize)]
pub struct CameraFindings {
    /// Name of the video.
    pub name: String,
    /// Name in the calibration.
    pub calibrated_name: String,
    /// What ffprobe says.
    pub probe: Probe,
    /// Focal lengths in pixels.
    pub focal_px: [f64; 2],
    /// Position in the world.
    pub position: [f64; 3],
    /// Direction in which it looks.
    pub forward: [f64; 3],
}

impl CameraFindings {
    pub(super) fn new(video: &RigVideo, RigCamera { name, camera, .. }: &RigCamera) -> CameraFindings {
        let [x, y, z, _] = camera.camera_from_world[2];
        CameraFindings {
            name: video.name.clone(),
            calibrated_name: name.clone(),
            probe: Probe { times_s: Vec::new(), ..video.probe.clone() },
            focal_px: [camera.k[0][0], camera.k[1][1]],
            position: camera.position(),
            forward: [x, y, z],
        }
    }
}

/// Where starts come from, in a sentence without its point.
pub(super) fn describe_source(source: StartSource) -> &'static str {
    match source {
        StartSource::Together => "The videos start together, as stated",
        StartSource::File => "A file states when the videos start",
        StartSource::Timecode => "Timecodes say when the videos start, to a frame",
        StartSource::Sound => {
            "Sound says when the videos start. It needs 2.9 ms for a metre, so cameras at different distances from what sounds differ \
             by that: 29 ms for 10 m"
        }
    }
}

/// Text with a capital letter.
pub(super) fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |first| first.to_uppercase().chain(chars).collect())
}

/// Where starts come from, and how sure they are.
pub(super) fn describe_starts(starts: &Starts, videos: &[RigVideo]) -> String {
    let first_s = starts.starts_s.iter().copied().fold(f64::INFINITY, f64::min);
    let within = format!("within {} s", decimal(-first_s, 3));
    let text = match starts.source {
        StartSource::Together if videos.len() == 1 => return "one camera".into(),
        StartSource::Together => "together, as stated".to_owned(),
        StartSource::File => format!("{within}, as stated"),
        StartSource::Timecode => format!("{within}, by timecode, to a frame"),
        StartSource::Sound => {
            format!("{within}, by sound, which is late by 29 ms for 10 m between a camera and what sounds")
        }
    };
    let Some(sound) = &starts.sound else { return text };
    let used = sound.pairs.iter().filter(|pair| pair.residual_s.is_some());
    let worst_s = used.clone().filter_map(|pair| pair.residual_s).map(f64::abs).fold(0.0, f64::max);
    let least = used.clone().map(|pair| pair.confidence).fold(f64::INFINITY, f64::min);
    format!(
        "{text}; {} of {} agree to {} ms, and peak at least {least:.0} times over the median ({CONFIDENCE_MIN} are needed)",
        used.count(),
        count(sound.pairs.len(), "pair"),
        decimal(1e3 * worst_s, 3)
    )
}

/// Sentences about clocks that drift.
pub(super) fn drift_warnings(starts: &Starts, videos: &[RigVideo], fps: f64, frames: usize) -> Vec<String> {
    let Some(sound) = &starts.sound else { return Vec::new() };
    let half_s = 0.5 * frames as f64 / fps;
    let warning = |(video, drift_ppm): (&RigVideo, &f64)| {
        let off_s = 1e-6 * drift_ppm.abs() * half_s;
        let name = &video.name;
        if drift_ppm.abs() > DRIFT_MAX_PPM {
            Some(format!(
                "{name}: its clock drifts by {drift_ppm:.0} ppm against the others, more than {DRIFT_MAX_PPM:.0}, so its times are up \
                 to {:.1} ms wrong; check that it was recorded and converted at its true rate",
                1e3 * off_s
            ))
        } else if off_s * fps > DRIFT_FRAMES {
            Some(format!(
                "{name}: its clock drifts by {drift_ppm:.0} ppm against the others, so its times are up to {:.1} ms wrong at the ends; \
                 ingest shorter parts",
                1e3 * off_s
            ))
        } else {
            None
        }
    };
    videos.iter().zip(&sound.drifts_ppm).filter_map(warning).collect()
}

/// What the check against pictures tells.
pub(super) fn describe_epipolar(check: &EpipolarCheck) -> String {
    let telling: Vec<f64> = check.pairs.iter().filter_map(|pair| pair.all.median_px).collect();
    let how_many = format!("{} of {} match enough to tell", telling.len(), count(check.pairs.len(), "pair"));
    let worst = telling.iter().copied().max_by(f64::total_cmp);
    match median(telling).zip(worst) {
        None => format!("not checked: {how_many}"),
        Some((median, worst)) => format!(
            "corners are {} px from their epipolar lines, at worst {} px ({how_many})",
            decimal(median, 2),
            decimal(worst, 2)
        ),
    }
}

/// Thousands of pixels on the longer side of a video, at least 1.
fn thousands(video: &RigVideo) -> f64 {
    let (width, height) = video.probe.size;
    (f64::from(width.max(height)) / 1000.0).max(1.0)
}

/// Sentences about calibrations that do not fit and cameras that moved.
pub(super) fn epipolar_warnings(check: &EpipolarCheck, videos: &[RigVideo]) -> Vec<String> {
    let mut warnings = Vec::new();
    for pair in &check.pairs {
        let [a, b] = pair.cameras.map(|camera| &videos[camera].name);
        let limit_px = EPIPOLAR_MAX_PX
            * pair.cameras.map(|camera| thousands(&videos[camera])).into_iter().fold(1.0, f64::max);
        if let Some(median_px) = pair.all.median_px.filter(|median_px| *median_px > limit_px) {
            warnings.push(format!(
                "{a} and {b}: matched corners are {} px from their epipolar lines; check the calibration, and that it is of these \
                 videos",
                decimal(median_px, 1)
            ));
        }
    }
    for (video, moved_px) in videos.iter().zip(&check.moved_px) {
        let limit_px = MOVED_PX * thousands(video);
        let worst = moved_px.iter().flatten().copied().fold(0.0, f64::max);
        if worst > limit_px {
            warnings.push(format!(
                "{}: its picture moves by {} px from the start, so the camera moved; calibrate it anew, or take it away",
                video.name,
                decimal(worst, 1)
            ));
        }
    }
    warnings
}

/// A share as percent.
pub(super) fn percent(share: f64) -> String {
    decimal(100.0 * share, 1)
}

/// What plates are made of, and how much of the pictures is subject.
pub(super) fn describe_mattes(mattes: &[CameraMattes]) -> String {
    let is_median = mattes.iter().all(|camera| camera.source == PlateSource::Median);
    let plates = match is_median {
        true => format!("plates are medians of up to {PICTURES_MAX} frames of each video"),
        false => "plates are of pictures without the subject".to_owned(),
    };
    let shares: Vec<f64> = mattes.iter().filter_map(CameraMattes::mean_share).collect();
    let least = shares.iter().copied().fold(f64::INFINITY, f64::min);
    let most = shares.iter().copied().fold(0.0, f64::max);
    match shares.is_empty() {
        true => format!("none, as asked; {plates}"),
        false => {
            format!("the subject covers {} to {} % of the pictures; {plates}", percent(least), percent(most))
        }
    }
}

/// Sentences about mattes that find next to nothing or too much, and about plates of another exposure.
pub(super) fn matte_warnings(mattes: &[CameraMattes], videos: &[RigVideo]) -> Vec<String> {
    let mut warnings = Vec::new();
    for (camera, RigVideo { name, .. }) in mattes.iter().zip(videos) {
        let [r, g, b] = camera.gains;
        let beyond = |limit: f64| [r, g, b].iter().any(|gain| gain.ln().abs() > limit);
        let what = match beyond(GAIN_MAX.ln()) {
            true => {
                "beyond a factor of 2 it gives no mattes; record the plate with the exposure of the video"
            }
            false => "mattes make up for that, but a plate of the same exposure is better",
        };
        if beyond(GAIN_NOTED) {
            warnings.push(format!(
                "{name}: its pictures are {r:.2}, {g:.2} and {b:.2} times as bright as its plate in red, green and blue; {what}"
            ));
        }
        let Some(share) = camera.mean_share() else { continue };
        let [least, most] = SHARES;
        if share < least {
            warnings.push(format!(
                "{name}: the subject covers {} % of its pictures; if it is there, it hardly moves and became part of the plate: record \
                 plates without it, and name them with --plates",
                decimal(100.0 * share, 2)
            ));
        } else if share > most {
            warnings.push(format!(
                "{name}: the subject covers {} % of its pictures; look whether the camera or the background moves, or the light changes, \
                 or use --mattes off",
                percent(share)
            ));
        }
    }
    warnings
}
