//! Finds the videos of a rig's folder and probes them: size, rate, rotation, duration, sound, timecode.

use std::path::{Path, PathBuf};

use program::Fault;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::store::{Store, file_name, identity};
use crate::capture::{Video, bad};
use crate::ffmpeg;
use crate::messages::unreadable;

/// File extensions of videos.
pub(super) const EXTENSIONS: [&str; 3] = ["mp4", "mov", "mkv"];

/// Deviation of an interval between frames from the median that counts as rounding, in intervals.
const UNEVEN: f64 = 0.02;

/// Seconds by which sound may go on for longer than pictures where nothing states the number of these.
const SOUND_ALONE_S: f64 = 1.0;

/// Intervals that the last picture may last there.
const LAST_FRAME: f64 = 5.0;

/// A video of the folder.
#[derive(Clone, Debug)]
pub(super) struct RigVideo {
    /// File name without extension.
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) probe: Probe,
}

/// What ffprobe says of a video.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// Width and height, upright.
    pub size: (u32, u32),
    /// Degrees by which players turn the stored pictures, clockwise; 0, 90, 180 or 270.
    pub rotation: i32,
    /// Name of the codec.
    pub codec: String,
    /// Frames per second, 1 over the median interval.
    pub fps: f64,
    /// Whether the intervals between frames differ.
    pub is_variable: bool,
    /// Number of frames.
    pub frames: usize,
    /// Seconds from the first frame to the last.
    pub duration_s: f64,
    /// Seconds from the start of the file to its first frame.
    pub first_s: f64,
    /// Whether there is a sound track.
    pub has_sound: bool,
    /// Timecode of the first frame, as the file states it.
    pub timecode: Option<String>,
    /// Presentation times in seconds since the first frame.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub times_s: Vec<f64>,
}

/// Paths of the videos in a folder, by name.
///
/// # Errors
/// [`Fault::Data`] if the folder cannot be read or has none.
pub(super) fn find(folder: &Path) -> Result<Vec<PathBuf>, Fault> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        let path = entry.map_err(|error| unreadable(folder, &error))?.path();
        let extension = path.extension().and_then(|x| x.to_str()).unwrap_or_default().to_lowercase();
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if EXTENSIONS.contains(&extension.as_str()) && !is_hidden && path.is_file() {
            paths.push(path);
        }
    }
    paths.sort();
    match paths.is_empty() {
        true => {
            Err(bad(folder, "there is no video in it; put one mp4, mov or mkv file for each camera there"))
        }
        false => Ok(paths),
    }
}

/// Probes a video, or takes what an earlier run found.
///
/// # Errors
/// [`Fault::Usage`] if there is no ffprobe; [`Fault::Data`] if it cannot read the file, or the file is cut off.
pub(super) fn probe(store: &Store, path: &Path) -> Result<(RigVideo, bool), Fault> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let key = json!(identity(path)?);
    let whole = path.file_name().unwrap_or_default().to_string_lossy();
    let (probe, is_kept) = store.result(&format!("probe-{}", file_name(&whole)), &key, || probed(path))?;
    Ok((RigVideo { name, path: path.to_owned(), probe }, is_kept))
}

fn probed(path: &Path) -> Result<Probe, Fault> {
    let video = Video::open(path)?;
    let entries = "stream=codec_type,codec_name,nb_frames:stream_tags=timecode:stream_side_data=rotation:\
                   format=duration,start_time:format_tags=timecode";
    let output = ffmpeg::output("ffprobe", |command| {
        command.args(["-v", "error", "-show_entries", entries, "-of", "json"]).arg(path);
    })?;
    let said: Said = serde_json::from_slice(&output.stdout)
        .map_err(|error| bad(path, format!("ffprobe says nothing of it: {error}; convert it to MP4")))?;
    let is = |kind: &'static str| move |stream: &&Stream| stream.codec_type.as_deref() == Some(kind);
    let Some(pictures) = said.streams.iter().find(is("video")) else {
        return Err(bad(path, "it has no video; name a video file"));
    };
    let frames = video.times_s.len();
    // MP4 counts its frames before their data, and a copy that was cut off lacks the last of them.
    if let Some(stated) = pictures.nb_frames.as_ref().and_then(|text| text.parse::<usize>().ok())
        && frames < stated
    {
        return Err(bad(
            path,
            format!("the file is cut off after frame {frames} of {stated}; copy or record it again"),
        ));
    }
    let (fps, is_variable) = rate(&video.times_s)
        .ok_or_else(|| bad(path, "it has a single frame; record it again, or convert it to MP4"))?;
    // Matroska states when it ends, and no number of frames.
    let start_s = said.format.start_time.as_ref().and_then(|text| text.parse::<f64>().ok()).unwrap_or(0.0);
    let last_s = video.first_s + video.times_s[frames - 1];
    let has_sound = said.streams.iter().any(|stream| is("audio")(&stream));
    let slack_s = if has_sound { SOUND_ALONE_S } else { LAST_FRAME / fps };
    if let Some(stated_s) = said.format.duration.as_ref().and_then(|text| text.parse::<f64>().ok())
        && pictures.nb_frames.is_none()
        && stated_s > start_s + last_s + slack_s
    {
        return Err(bad(
            path,
            format!(
                "pictures end after {last_s:.2} of {:.2} s: the file is cut off; copy or record it again, or cut its \
                 sound to the pictures",
                stated_s - start_s
            ),
        ));
    }
    let rotation = pictures.side_data_list.iter().find_map(|data| data.rotation).unwrap_or(0.0);
    let timecodes = said.streams.iter().map(|stream| &stream.tags).chain([&said.format.tags]);
    Ok(Probe {
        size: video.size,
        // ffprobe counts anticlockwise.
        rotation: (-rotation.round() as i32).rem_euclid(360),
        codec: pictures.codec_name.clone().unwrap_or_default(),
        fps,
        is_variable,
        frames,
        duration_s: video.times_s[frames - 1],
        first_s: video.first_s,
        has_sound,
        timecode: timecodes.filter_map(|tags| tags.timecode.clone()).next(),
        times_s: video.times_s,
    })
}

/// Frames per second by the median interval, and whether intervals differ from it; `None` of a single frame.
fn rate(times_s: &[f64]) -> Option<(f64, bool)> {
    let mut intervals: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    intervals.sort_by(f64::total_cmp);
    let median = *intervals.get(intervals.len() / 2)?;
    // Times of some formats are whole milliseconds.
    let slack = (UNEVEN * median).max(0.001_1);
    let is_variable = intervals.iter().any(|interval| (interval - median).abs() > slack);
    // The mean knows the rate more exactly than rounded times do.
    let mean = times_s.last()? / (times_s.len() - 1) as f64;
    Some((1.0 / if is_variable { median } else { mean }, is_variable))
}

#[derive(Deserialize)]
struct Said {
    #[serde(default)]
    streams: Vec<Stream>,
    #[serde(default)]
    format: Format,
}

#[derive(Deserialize)]
struct Stream {
    codec_type: Option<String>,
    codec_name: Option<String>,
    nb_frames: Option<String>,
    #[serde(default)]
    tags: Tags,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

#[derive(Default, Deserialize)]
struct Format {
    duration: Option<String>,
    start_time: Option<String>,
    #[serde(default)]
    tags: Tags,
}

#[derive(Default, Deserialize)]
struct Tags {
    timecode: Option<String>,
}

#[derive(Deserialize)]
struct SideData {
    rotation: Option<f64>,
}

/// The commonest rate of the videos, of those that differ by less than rounding; the higher of two as common.
pub(super) fn commonest_fps(videos: &[RigVideo]) -> f64 {
    let rate = |video: &RigVideo| nominal_fps(video.probe.fps);
    let count = |fps: f64| videos.iter().filter(|video| rate(video) == fps).count();
    let rates = videos.iter().map(rate);
    rates.max_by(|a, b| count(*a).cmp(&count(*b)).then(a.total_cmp(b))).unwrap_or(1.0)
}

/// A measured rate, or the usual one that is next to it.
fn nominal_fps(fps: f64) -> f64 {
    let usual = [1.0, 1000.0 / 1001.0].into_iter().map(|factor| (fps / factor).round() * factor);
    let nearest = usual.min_by(|a, b| (a - fps).abs().total_cmp(&(b - fps).abs())).unwrap_or(fps);
    if nearest > 0.0 && (nearest / fps - 1.0).abs() < 5e-4 { nearest } else { fps }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A silent video of 2 s.
    pub(in crate::ingest) fn video(name: &str, fps: f64) -> RigVideo {
        let frames = (2.0 * fps) as usize;
        let times_s: Vec<f64> = (0..frames).map(|i| i as f64 / fps).collect();
        let probe = Probe {
            size: (64, 48),
            rotation: 0,
            codec: "h264".into(),
            fps,
            is_variable: false,
            frames,
            duration_s: times_s[frames - 1],
            first_s: 0.0,
            has_sound: false,
            timecode: None,
            times_s,
        };
        RigVideo { name: name.into(), path: PathBuf::from(format!("{name}.mp4")), probe }
    }

    #[test]
    fn rates_are_constant_up_to_rounding() {
        let even: Vec<f64> = (0..50).map(|i| (f64::from(i) / 30.0 * 1e3).round() / 1e3).collect();
        let (fps, is_variable) = rate(&even).unwrap();
        assert!((fps - 30.0).abs() < 0.02 && !is_variable, "{fps}");
        let gap: Vec<f64> = (0..50).map(|i| f64::from(i + i / 20) / 30.0).collect();
        let (fps, is_variable) = rate(&gap).unwrap();
        assert!((fps - 30.0).abs() < 1e-6 && is_variable, "{fps}");
        assert_eq!(rate(&[0.0]), None);
    }

    #[test]
    fn a_usual_rate_is_recognised() {
        assert_eq!(
            [30.0002, 29.9699, 59.9405, 25.0].map(nominal_fps),
            [30.0, 30000.0 / 1001.0, 60000.0 / 1001.0, 25.0]
        );
        assert_eq!(nominal_fps(17.3), 17.3);
    }
}
