//! [`Soundtrack`]: the sound of a clip or a take, encoded, and what became of its file.

use std::path::{Path, PathBuf};

use codec::{SOUND_RATE_HZ, Sound};
use program::Fault;
use serde::Serialize;

use super::packets::Stream;
use super::samples::{Samples, probe};
use super::source::SoundSource;
use crate::messages::decimal;

/// Differences in seconds between sound and clip that are not worth a remark.
const SAME_S: f64 = 0.05;

/// The sound of a clip or a take, encoded.
#[derive(Debug)]
pub struct Soundtrack {
    pub(super) stream: Stream,
    /// Sample of the clip that is heard first, and number of samples that are heard.
    pub(super) start: u32,
    pub(super) length: u32,
    pub(super) position: Option<[f32; 3]>,
    pub(super) report: SoundReport,
}

/// What became of the sound of a file.
#[derive(Clone, Debug, Serialize)]
pub struct SoundReport {
    /// The file.
    pub file: PathBuf,
    /// Name of the codec.
    pub codec: &'static str,
    /// 1, or 2 for left and right.
    pub channels: u8,
    /// Samples a second.
    pub rate_hz: u32,
    /// Seconds that are heard.
    pub duration_s: f64,
    /// Bytes of packets.
    pub bytes: usize,
    /// Point of the scene from which it comes.
    pub position: Option<[f32; 3]>,
    /// What was repaired, mixed, left out or is missing.
    pub notes: Vec<String>,
}

impl SoundReport {
    /// One line without its name.
    pub(crate) fn describe(&self) -> String {
        let from = match (self.position, self.channels) {
            (Some([x, y, z]), _) => format!("mono from ({x}, {y}, {z})"),
            (None, 1) => "mono".into(),
            (None, _) => "stereo".into(),
        };
        let kbps = self.bytes as f64 * 8e-3 / self.duration_s;
        let (duration_s, file) = (decimal(self.duration_s, 3), self.file.display());
        format!("{duration_s} s of Opus, {from}, {} bytes, {kbps:.0} kbps, of {file}", self.bytes)
    }
}

impl Soundtrack {
    /// Checks that a file has a sound track.
    ///
    /// # Errors
    /// [`Fault::Usage`] if ffmpeg is missing; [`Fault::Data`] if the file cannot be read or has no sound.
    pub fn check(path: &Path) -> Result<(), Fault> {
        probe(path).map(drop)
    }

    /// Encodes the sound of a clip or a take of `duration_s` seconds. What lies outside it is left out.
    ///
    /// # Errors
    /// [`Fault::Usage`] if ffmpeg is missing, or the sound begins after the clip; [`Fault::Data`] if the file has no sound that it can decode, or none
    /// within the clip.
    pub fn encode(source: &SoundSource, duration_s: f64) -> Result<Soundtrack, Fault> {
        let bad = |what: String| Fault::Data(format!("{}: {what}", source.path.display()));
        let end = (duration_s * f64::from(SOUND_RATE_HZ)).round();
        if !(1.0..f64::from(u32::MAX)).contains(&end) {
            return Err(bad(format!("a clip of {duration_s} s can have no sound; leave --audio out")));
        }
        if source.start_s >= duration_s {
            let (start_s, duration_s) = (decimal(source.start_s, 3), decimal(duration_s, 3));
            return Err(Fault::Usage(format!(
                "--audio-start: {start_s} s is not within the clip of {duration_s} s; correct it"
            )));
        }
        let samples = Samples::decode(source, duration_s)?;
        let start = (source.start_s.max(0.0) * f64::from(SOUND_RATE_HZ)).round();
        let length = (end - start).min(samples.len() as f64);
        if length < 1.0 {
            let (from_s, to_s) =
                (decimal(source.start_s, 3), decimal(source.start_s + samples.duration_s(), 3));
            return Err(bad(format!(
                "its sound lies outside the clip, from {from_s} to {to_s} s of {} s; correct --audio-start",
                decimal(duration_s, 3)
            )));
        }
        let (start, length) = (start as u32, length as u32);
        let stream = Stream::encode(&samples, length as usize, &source.path)?;
        let seconds = |samples: f64| samples / f64::from(SOUND_RATE_HZ);
        let mut notes = samples.notes().to_vec();
        if samples.is_longer() {
            notes.push("it goes on behind the end of the clip; that is left out".into());
        }
        let silent_s = seconds(end - f64::from(start) - f64::from(length));
        if silent_s > SAME_S {
            notes.push(format!("it ends {} s before the clip, which is then silent", decimal(silent_s, 3)));
        }
        let report = SoundReport {
            file: source.path.clone(),
            codec: "opus",
            channels: samples.channels(),
            rate_hz: SOUND_RATE_HZ,
            duration_s: seconds(length.into()),
            bytes: stream.bytes(),
            position: source.position,
            notes,
        };
        Ok(Soundtrack { stream, start, length, position: source.position, report })
    }

    /// What became of the file.
    pub fn report(&self) -> &SoundReport {
        &self.report
    }

    /// The package of a clip with this sound.
    ///
    /// # Errors
    /// [`Fault::Data`] if the result would be too large.
    pub fn put_into(&self, package: &[u8], path: &Path) -> Result<Vec<u8>, Fault> {
        put(package, Some(&self.of_clip()), path)
    }
}

/// The package with this sound, in place of its own.
pub(crate) fn put(package: &[u8], sound: Option<&Sound>, path: &Path) -> Result<Vec<u8>, Fault> {
    codec::with_sound(package, sound)
        .map_err(|error| Fault::Data(format!("{}: {error}; leave --audio out", path.display())))
}
