//! Finds the videos of a rig's folder and probes them: size, rate, rotation, duration, sound, timecode.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use formats::list_of;
use program::Fault;
use refine::metrics::median;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::store::{Store, file_name, identity};
use crate::capture::{UnusualPictures, Video, bad};
use crate::ffmpeg::{self, Probed};
use crate::messages::unreadable;

/// File extensions of videos.
pub(super) const EXTENSIONS: [&str; 6] = ["mp4", "mov", "mkv", "avi", "m4v", "webm"];

/// File extensions of videos that are not read: raw recordings, previews, spherical pictures, what few cameras
/// write, and transport streams (mts), in which ffmpeg does not seek to a frame exactly.
const UNREAD: [&str; 18] = [
    "360", "3gp", "braw", "crm", "flv", "insv", "lrv", "m2ts", "mod", "mpeg", "mpg", "mts", "mxf", "ogv",
    "r3d", "ts", "vob", "wmv",
];

/// Deviation of an interval between frames from the usual one that counts as rounding, in intervals.
const UNEVEN: f64 = 0.02;

/// Intervals from the median on that count as a gap, in which frames are missing.
const GAP: f64 = 1.5;

/// Deviation of a gap from a whole number of intervals up to which that number of frames is missing.
const OFF_GRID: f64 = 0.15;

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
    /// Frames per second, without regard to missing frames.
    pub fps: f64,
    /// Whether the intervals between frames differ.
    pub is_variable: bool,
    /// Number of frames.
    pub frames: usize,
    /// Seconds from the first frame to the last.
    pub duration_s: f64,
    /// Seconds from the start of the file to its first frame.
    pub first_s: f64,
    /// What it states of its pictures that is not followed.
    #[serde(flatten)]
    pub unusual: UnusualPictures,
    /// Whether there is a sound track.
    pub has_sound: bool,
    /// Timecode of the first frame, as the file states it.
    pub timecode: Option<String>,
    /// Frames per second of the track of timecodes, which may be half of the pictures'.
    pub timecode_fps: Option<f64>,
    /// Presentation times in seconds since the first frame.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub times_s: Vec<f64>,
}

/// Paths of the videos in a folder, by name. Files that are ignored and look like videos are named in `warnings`.
///
/// # Errors
/// [`Fault::Data`] if the folder cannot be read or has none.
pub(super) fn find(folder: &Path, warnings: &mut Vec<String>) -> Result<Vec<PathBuf>, Fault> {
    let (mut paths, mut ignored) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))? {
        let path = entry.map_err(|error| unreadable(folder, &error))?.path();
        let extension = path.extension().and_then(|x| x.to_str()).unwrap_or_default().to_lowercase();
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if is_hidden || !path.is_file() {
            continue;
        }
        if EXTENSIONS.contains(&extension.as_str()) {
            paths.push(path);
        } else if UNREAD.contains(&extension.as_str()) {
            ignored.push(path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        }
    }
    paths.sort();
    ignored.sort();
    let known = EXTENSIONS.join(", ");
    let note = list_of(ignored.iter().map(String::as_str))
        .map(|names| format!("{names}: not read, convert what is a camera's video to one of {known}"));
    if paths.is_empty() {
        let note = note.map_or_else(String::new, |note| format!("; {note}"));
        return Err(bad(
            folder,
            format!("there is no video in it; put one file for each camera there, of {known}{note}"),
        ));
    }
    warnings.extend(note);
    Ok(paths)
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
    // The first video stream of the file may be a cover.
    let pictures = &video.stream;
    let entries = "stream=codec_type,codec_tag_string,avg_frame_rate:stream_tags:\
                   format=duration,start_time:format_tags";
    let said = asked(path, &["-show_entries", entries])?;
    let frames = video.times_s.len();
    // MP4 counts its frames before their data, and a copy that was cut off lacks the last of them.
    if let Some(stated) = number::<usize>(&pictures.nb_frames)
        && frames < stated
        && packets(path)? < stated
    {
        let what = format!("the file is cut off after frame {frames} of {stated}; copy or record it again");
        return Err(bad(path, what));
    }
    let (fps, is_variable) = rate(&video.times_s)
        .ok_or_else(|| bad(path, "it has a single frame; record it again, or convert it to MP4"))?;
    // Matroska states when it ends, and no number of frames.
    let start_s = number(&said.format.start_time).unwrap_or(0.0);
    let last_s = video.first_s + video.times_s[frames - 1];
    let has_sound = said.streams.iter().any(|stream| stream.codec_type.as_deref() == Some("audio"));
    let slack_s = if has_sound { SOUND_ALONE_S } else { LAST_FRAME / fps };
    if let Some(stated_s) = number::<f64>(&said.format.duration)
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
    let tags = said.streams.iter().map(|stream| &stream.tags).chain([&said.format.tags]);
    let track = said.streams.iter().find(|stream| stream.codec_tag_string.as_deref() == Some("tmcd"));
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
        unusual: video.unusual,
        has_sound,
        timecode: tags.filter_map(timecode).next(),
        timecode_fps: track.and_then(|track| ratio(track.avg_frame_rate.as_deref()?)),
        times_s: video.times_s,
    })
}

/// What ffprobe says of a file, of at least one of its streams.
fn asked(path: &Path, arguments: &[&str]) -> Result<Probed, Fault> {
    let said = ffmpeg::probed(path, arguments)?;
    if said.streams.is_empty() {
        let error = said.error.unwrap_or_else(|| "no stream".into());
        return Err(bad(path, format!("ffprobe says nothing of it: {error}; convert it to MP4")));
    }
    Ok(said)
}

/// Number of pictures in an MP4, with those that its edit list hides: a part that was cut without recoding has frames
/// before its first and after its last one.
fn packets(path: &Path) -> Result<usize, Fault> {
    let entries = "stream=nb_read_packets";
    let said = asked(
        path,
        &["-ignore_editlist", "1", "-select_streams", "V:0", "-count_packets", "-show_entries", entries],
    )?;
    Ok(said.streams.first().and_then(|stream| number(&stream.nb_read_packets)).unwrap_or(0))
}

fn number<T: FromStr>(text: &Option<String>) -> Option<T> {
    text.as_ref()?.parse().ok()
}

/// The value of a fraction such as `30000/1001`.
fn ratio(text: &str) -> Option<f64> {
    let (above, below) = text.split_once('/')?;
    let value = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

/// The timecode in the tags of a file or a stream; Matroska writes their names in capitals.
fn timecode(tags: &BTreeMap<String, String>) -> Option<String> {
    tags.iter().find(|(name, _)| name.eq_ignore_ascii_case("timecode")).map(|(_, value)| value.clone())
}

/// Frames per second, and whether intervals differ; `None` of a single frame.
///
/// Times of some formats are whole milliseconds, so that a median of intervals would be up to 3 % off. It only tells which
/// frames are one interval apart; the interval is fitted to all times by least squares, first without gaps and then with
/// those that are whole numbers of intervals.
fn rate(times_s: &[f64]) -> Option<(f64, bool)> {
    let intervals = || times_s.windows(2).map(|pair| pair[1] - pair[0]);
    let median_s = median(intervals().collect()).filter(|interval_s| *interval_s > 0.0)?;
    let without_gaps = fitted_interval_s(times_s, |interval_s| (interval_s < GAP * median_s).then_some(1.0));
    let interval_s = fitted_interval_s(times_s, |time_s| {
        let steps = (time_s / without_gaps).round().max(1.0);
        ((time_s / without_gaps - steps).abs() < OFF_GRID || time_s < GAP * median_s).then_some(steps)
    });
    let slack_s = (UNEVEN * interval_s).max(0.001_1);
    Some((1.0 / interval_s, intervals().any(|interval| (interval - interval_s).abs() > slack_s)))
}

/// The interval that fits runs of times best; `steps` tells how many intervals lie between two times of a run.
fn fitted_interval_s(times_s: &[f64], steps: impl Fn(f64) -> Option<f64>) -> f64 {
    let (mut above, mut below) = (0.0, 0.0);
    for run in times_s.chunk_by(|a, b| steps(b - a).is_some()) {
        let mut numbers = vec![0.0];
        for pair in run.windows(2) {
            numbers.push(numbers[numbers.len() - 1] + steps(pair[1] - pair[0]).unwrap_or_default());
        }
        let middle = numbers.iter().sum::<f64>() / numbers.len() as f64;
        for (number, time_s) in numbers.iter().zip(run) {
            above += (number - middle) * (time_s - run[0]);
            below += (number - middle).powi(2);
        }
    }
    above / below
}

/// The commonest rate of the videos, of those that differ by less than rounding; the higher of two as common.
pub(super) fn commonest_fps(videos: &[RigVideo]) -> f64 {
    let rate = |video: &RigVideo| nominal_fps(video.probe.fps);
    let count = |fps: f64| videos.iter().filter(|video| rate(video) == fps).count();
    let rates = videos.iter().map(rate);
    rates.max_by(|a, b| count(*a).cmp(&count(*b)).then(a.total_cmp(b))).unwrap_or(1.0)
}

/// A measured rate, or the usual one that is next to it.
pub(super) fn nominal_fps(fps: f64) -> f64 {
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
            unusual: UnusualPictures::default(),
            has_sound: false,
            timecode: None,
            timecode_fps: None,
            times_s,
        };
        RigVideo { name: name.into(), path: PathBuf::from(format!("{name}.mp4")), probe }
    }

    #[test]
    fn rates_are_constant_up_to_rounding() {
        // The numbers of the frames that are there, and the times that Matroska gives them.
        let rate_of = |fps: f64, is_there: fn(u32) -> bool| {
            let there = (0..240).filter(|i| is_there(*i));
            let times_s: Vec<f64> = there.map(|i| (f64::from(i) / fps * 1e3).round() / 1e3).collect();
            rate(&times_s).unwrap()
        };
        for fps in [24000.0 / 1001.0, 25.0, 30000.0 / 1001.0, 30.0, 60000.0 / 1001.0, 60.0, 120.0] {
            let are_there: [fn(u32) -> bool; 4] =
                [|_| true, |i| i != 77, |i| i % 20 != 19, |i| !(50..150).contains(&i)];
            for (number, is_there) in are_there.into_iter().enumerate() {
                let (found, is_variable) = rate_of(fps, is_there);
                let has_gap = number > 0;
                assert!((found / fps - 1.0).abs() < 2e-4 && is_variable == has_gap, "{found} for {fps}");
            }
        }
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
