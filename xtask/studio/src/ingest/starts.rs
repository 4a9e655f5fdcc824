//! [`Starts`]: when the first frame of each video was taken: stated, by timecode, or by sound.

use std::path::Path;

use program::Fault;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

use super::options::Offsets;
use super::sound::{self, SoundSync, Track};
use super::store::{Store, identity};
use super::videos::{RigVideo, nominal_fps};
use crate::capture::{bad, read_text};
use crate::messages::decimal;

/// Seconds by which timecodes and sound may differ, besides two frames: the way of sound through 10 m.
const SOUND_WAY_S: f64 = 0.029;

/// Where starts come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StartSource {
    /// All videos start together, as stated.
    Together,
    /// A file states them.
    File,
    /// The timecodes of the files.
    Timecode,
    /// Their sound.
    Sound,
}

/// When videos start.
#[derive(Clone, Debug, Serialize)]
pub struct Starts {
    /// Where they come from.
    pub source: StartSource,
    /// Second of the first frame of each video. The last camera to start does so at 0.
    pub starts_s: Vec<f64>,
    /// What the sound says, if it was compared.
    pub sound: Option<SoundSync>,
    /// Whether an earlier run compared it.
    #[serde(skip)]
    pub is_kept: bool,
}

impl Starts {
    /// Number of the video whose sound is the capture's: the video that agrees best with all others, or the first with
    /// sound where none were compared.
    pub(super) fn sound_of(&self, videos: &[RigVideo]) -> Option<usize> {
        let agreement = |i: usize| {
            let pairs = self.sound.iter().flat_map(|sound| &sound.pairs);
            pairs.filter(|pair| pair.cameras.contains(&i)).map(|pair| pair.confidence).sum::<f64>()
        };
        let has_sound = (0..videos.len()).filter(|i| videos[*i].probe.has_sound);
        // The first of several.
        has_sound.rev().max_by(|a, b| agreement(*a).total_cmp(&agreement(*b)))
    }
}

/// Finds when `videos` start; warnings go to `warn`, and `say` gets a line for each step of a long search.
///
/// # Errors
/// [`Fault::Data`] if nothing says so, or what does cannot be read or believed.
pub(super) fn find(
    store: &Store,
    videos: &[RigVideo],
    offsets: &Offsets,
    warn: &mut Vec<String>,
    say: &mut dyn FnMut(&str),
) -> Result<Starts, Fault> {
    let known = |source, starts_s| Starts { source, starts_s, sound: None, is_kept: false };
    let starts = match offsets {
        Offsets::Together => known(StartSource::Together, vec![0.0; videos.len()]),
        Offsets::File(path) => known(StartSource::File, stated(path, videos)?),
        Offsets::Found if videos.len() == 1 => known(StartSource::Together, vec![0.0]),
        Offsets::Found => found(store, videos, warn, say)?,
    };
    let last_s = starts.starts_s.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let starts_s: Vec<f64> = starts.starts_s.iter().map(|start_s| start_s - last_s).collect();
    for (video, start_s) in videos.iter().zip(&starts_s) {
        let end_s = start_s + video.probe.duration_s;
        if end_s <= 0.0 {
            return Err(bad(
                &video.path,
                format!(
                    "it ends {:.3} s before the last camera starts; take it away, or correct --offsets",
                    -end_s
                ),
            ));
        }
    }
    Ok(Starts { starts_s, ..starts })
}

/// Starts by timecode where all videos have one, else by sound. Both are compared where there are both.
fn found(
    store: &Store,
    videos: &[RigVideo],
    warn: &mut Vec<String>,
    say: &mut dyn FnMut(&str),
) -> Result<Starts, Fault> {
    let has_sound = videos.iter().all(|video| video.probe.has_sound);
    let Some(timecodes) = timecodes_s(videos) else {
        if !has_sound {
            let silent = videos.iter().filter(|video| !video.probe.has_sound);
            let names: Vec<&str> = silent.map(|video| video.name.as_str()).collect();
            let same = if videos.iter().all(|video| video.probe.timecode.is_some()) {
                " and no timecodes but those that editors write"
            } else {
                ""
            };
            return Err(Fault::Data(format!(
                "no sound in {}{same}, so nothing says when the videos start; state it with --offsets FILE, or that they start together \
                 with --offsets none",
                names.join(", ")
            )));
        }
        return by_sound(store, videos, say);
    };
    let by_timecode =
        Starts { source: StartSource::Timecode, starts_s: timecodes, sound: None, is_kept: false };
    let Some(by_sound) = has_sound.then(|| by_sound(store, videos, say)) else { return Ok(by_timecode) };
    // Sound of another event says nothing against timecodes.
    let Ok(by_sound) = by_sound else {
        warn.push(
            "the videos have sound, but not of one event; only their timecodes say when they start".into(),
        );
        return Ok(by_timecode);
    };
    let apart = |i: usize, j: usize| {
        let [a, b] = [&by_timecode.starts_s, &by_sound.starts_s].map(|starts_s| starts_s[i] - starts_s[j]);
        (a - b).abs()
    };
    let slack_s =
        SOUND_WAY_S + 2.0 / videos.iter().map(|video| video.probe.fps).fold(f64::INFINITY, f64::min);
    let worst = (1..videos.len()).max_by(|a, b| apart(*a, 0).total_cmp(&apart(*b, 0))).unwrap_or(0);
    match apart(worst, 0) <= slack_s {
        true => Ok(Starts { sound: by_sound.sound, is_kept: by_sound.is_kept, ..by_timecode }),
        false => {
            warn.push(format!(
                "timecodes and sound differ by {} s between {} and {}, so sound is believed; state starts with --offsets FILE if \
                 it is wrong",
                decimal(apart(worst, 0), 3),
                videos[0].name,
                videos[worst].name
            ));
            Ok(by_sound)
        }
    }
}

fn by_sound(store: &Store, videos: &[RigVideo], say: &mut dyn FnMut(&str)) -> Result<Starts, Fault> {
    let tracks = videos
        .par_iter()
        .map(|video| Track::extract(store, &video.path).map(|(track, _)| track))
        .collect::<Result<Vec<_>, Fault>>()?;
    let key = videos.iter().map(|video| identity(&video.path)).collect::<Result<Vec<_>, Fault>>()?;
    let name = |camera: usize| videos[camera].name.clone();
    let (sound, is_kept) = store.result("sound", &json!(key), || sound::synchronise(&tracks, &name, say))?;
    // Sound tells when files start; their first frame may be later.
    let first_frame_s =
        sound.starts_s.iter().zip(videos).map(|(start_s, video)| start_s + video.probe.first_s);
    Ok(Starts { source: StartSource::Sound, starts_s: first_frame_s.collect(), sound: Some(sound), is_kept })
}

/// Seconds at which videos start by their timecodes; `None` if one has none, or all are the same whole hour: editors write
/// 00:00:00:00 or 01:00:00:00 into whatever they export. Starts are within half a day of the first one: timecodes begin
/// again at midnight.
fn timecodes_s(videos: &[RigVideo]) -> Option<Vec<f64>> {
    let seconds = videos.iter().map(timecode_s).collect::<Option<Vec<[f64; 2]>>>()?;
    let first_s = seconds.first()?[0];
    let is_editors = |video: &RigVideo| {
        let text = video.probe.timecode.as_deref().unwrap_or_default();
        video.probe.timecode == videos[0].probe.timecode
            && text.split([':', ';', '.']).skip(1).all(|part| part == "00")
    };
    if videos.iter().all(is_editors) {
        return None;
    }
    let near = |[start_s, day_s]: &[f64; 2]| start_s - day_s * ((start_s - first_s) / day_s).round();
    Some(seconds.iter().map(near).collect())
}

/// The second of the day at which a video starts by its timecode, and the seconds after which timecodes begin again.
fn timecode_s(video: &RigVideo) -> Option<[f64; 2]> {
    let text = video.probe.timecode.as_deref()?;
    let parts: Vec<u32> =
        text.split([':', ';', '.']).map(|part| part.parse().ok()).collect::<Option<Vec<_>>>()?;
    let parts = <[u32; 4]>::try_from(parts).ok()?;
    // A measured rate differs a little from camera to camera, which an hour makes seconds.
    let fps = video.probe.timecode_fps.unwrap_or_else(|| nominal_fps(video.probe.fps));
    let seconds = |[hours, minutes, seconds, frames]: [u32; 4]| {
        let nominal = fps.round();
        let total_minutes = 60.0 * f64::from(hours) + f64::from(minutes);
        let count = (60.0 * total_minutes + f64::from(seconds)) * nominal + f64::from(frames);
        // SMPTE 12M: two numbers of 30 are left out each minute, except each tenth.
        let dropped = match text.contains(';') {
            true => (nominal / 15.0).floor() * (total_minutes - (total_minutes / 10.0).floor()),
            false => 0.0,
        };
        (count - dropped).max(0.0) / fps
    };
    Some([seconds(parts), seconds([24, 0, 0, 0])])
}

/// Reads lines of a name and seconds.
fn stated(path: &Path, videos: &[RigVideo]) -> Result<Vec<f64>, Fault> {
    let text = read_text(path)?;
    let mut starts_s: Vec<Option<f64>> = vec![None; videos.len()];
    for (number, line) in text.lines().enumerate() {
        let at = |problem: String| bad(path, format!("line {}: {problem}", number + 1));
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let parsed = line.rsplit_once(char::is_whitespace).and_then(|(name, seconds)| {
            Some((name.trim(), seconds.parse::<f64>().ok().filter(|seconds| seconds.is_finite())?))
        });
        let Some((name, seconds)) = parsed else {
            return Err(at(format!("\"{line}\" is no name and seconds; write them as: cam01 -0.25")));
        };
        let Some(video) = videos.iter().position(|video| video.name == name) else {
            return Err(at(format!("there is no video {name}; name it as its file, without extension")));
        };
        if starts_s[video].replace(seconds).is_some() {
            return Err(at(format!("{name} is listed twice; leave one line")));
        }
    }
    let missing = starts_s.iter().position(Option::is_none);
    match missing {
        Some(video) => Err(bad(path, format!("no line for the video {}; add one", videos[video].name))),
        None => Ok(starts_s.into_iter().flatten().collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::videos::tests::video;
    use super::*;

    #[test]
    fn timecodes_count_real_seconds() {
        // Seconds of the second video after the first; the rate as measured, and the rate of the track.
        let later_s = |rates: [(f64, Option<f64>); 2], texts: [&str; 2]| {
            let videos = [0, 1].map(|i| {
                let mut video = video("a", rates[i].0);
                video.probe.timecode_fps = rates[i].1;
                video.probe.timecode = Some(texts[i].into());
                video
            });
            timecodes_s(&videos).map(|starts_s| starts_s[1] - starts_s[0])
        };
        let (ntsc, double) = (30000.0 / 1001.0, 60000.0 / 1001.0);
        let exact = [25.0, 25.0].map(|fps| (fps, None));
        // A frame is missing, a clock drifts.
        let measured = [ntsc, ntsc * (1.0 - 2e-4)].map(|fps| (fps, None));
        for (rates, texts, expected_s) in [
            (exact, ["00:00:00:00", "01:00:01:05"], 3601.2),
            (exact, ["10:00:00:00", "10:00:00:05"], 0.2),
            (measured, ["10:00:00;00", "10:00:00;13"], 13.0 / ntsc),
            (measured, ["00:00:00;00", "01:00:00;00"], 107_892.0 / ntsc),
            (measured, ["00:00:00:00", "01:00:00:00"], 3603.6),
            ([(double, Some(ntsc)), (double, Some(ntsc))], ["01:00:00:00", "01:00:00:15"], 15.0 / ntsc),
            ([(double, Some(ntsc)), (ntsc, None)], ["10:00:00:03", "10:00:00:00"], -3.0 / ntsc),
            (exact, ["23:59:59:20", "00:00:00:10"], 0.6),
            (exact, ["00:00:00:10", "23:59:59:20"], -0.6),
            (measured, ["23:59:59:29", "00:00:00:01"], 2.0 / ntsc),
            (measured, ["23:59:59;29", "00:00:00;01"], 2.0 / ntsc),
        ] {
            let found_s = later_s(rates, texts).unwrap();
            assert!((found_s - expected_s).abs() < 1e-6, "{texts:?} {rates:?}: {found_s}, not {expected_s}");
        }
        for nothing in ["00:00:00:00", "01:00:00:00", "00:00:00;00"] {
            assert_eq!(later_s(exact, [nothing; 2]), None, "{nothing} of an editor");
        }
        assert_eq!(later_s(exact, ["10:00:00:05"; 2]), Some(0.0));
        for malformed in ["garbage", "01:00:00", "01:00:00:00:00", "01:00:-1:00", "4294967296:00:00:00"] {
            assert_eq!(later_s(exact, ["00:00:00:00", malformed]), None, "{malformed}");
        }
    }

    #[test]
    fn the_sound_of_the_capture_is_that_which_agrees_best() {
        let videos = |has_sound: [bool; 3]| {
            has_sound.map(|has_sound| {
                let mut video = video("a", 25.0);
                video.probe.has_sound = has_sound;
                video
            })
        };
        let pair = |cameras, confidence| sound::SoundPair {
            cameras,
            later_s: 0.0,
            drift_ppm: 0.0,
            confidence,
            residual_s: None,
            curve: Vec::new(),
        };
        let starts = |pairs: Vec<sound::SoundPair>| Starts {
            source: StartSource::Sound,
            starts_s: vec![0.0; 3],
            sound: (!pairs.is_empty()).then(|| SoundSync {
                starts_s: vec![0.0; 3],
                drifts_ppm: vec![0.0; 3],
                pairs,
            }),
            is_kept: false,
        };
        let compared = || starts(vec![pair([0, 1], 20.0), pair([0, 2], 30.0), pair([1, 2], 40.0)]);
        assert_eq!(compared().sound_of(&videos([true; 3])), Some(2));
        assert_eq!(starts(Vec::new()).sound_of(&videos([false, true, true])), Some(1));
        assert_eq!(starts(Vec::new()).sound_of(&videos([false; 3])), None);
    }

    #[test]
    fn a_file_states_each_video_once() {
        let videos = [video("a", 25.0), video("b c", 25.0)];
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str| {
            std::fs::write(file.path(), text).unwrap();
            stated(file.path(), &videos).map_err(|fault| fault.to_string())
        };
        assert_eq!(read("# when\na 0.5\nb c\t-1e-1 # late\n\n"), Ok(vec![0.5, -0.1]));
        for (text, problem) in [
            ("a 1", "no line for the video b c"),
            ("a", "is no name and seconds"),
            ("a nan", "is no name and seconds"),
            ("d 1", "there is no video d"),
            ("a 1\na 2", "line 2: a is listed twice"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
    }
}
