//! The sound of a package: any file that ffmpeg reads becomes packets of Opus, for a clip or for the segments of a take.
//!
//! ```text
//! samples: ffmpeg decodes, mixes to one or two channels at 48 kHz, into a scratch file; samples that are no numbers become
//!          silence, and what is above full scale is made quieter as a whole
//! packets: ffmpeg encodes the samples; the packets are taken out of its Ogg file
//! cut:     the packets of a clip, or of each segment of a take
//! ```

mod cut;
mod packets;
mod samples;

use std::path::{Path, PathBuf};

use codec::{SOUND_RATE_HZ, Sound};
use program::Fault;
use serde::Serialize;

use crate::messages::decimal;
use packets::Stream;
use samples::Samples;

/// Differences in seconds between sound and clip that are not worth a remark.
const SAME_S: f64 = 0.05;

/// Where the sound of a package comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct SoundSource {
    /// A file that ffmpeg reads, of which the first sound track counts.
    pub path: PathBuf,
    /// Second of the clip at which the file begins; below 0 for a file that begins before the clip.
    pub start_s: f64,
    /// Point of the scene from which the sound comes, in its axes and units; `None` for a stereo bed.
    pub position: Option<[f32; 3]>,
}

/// The sound of a clip or a take, encoded.
#[derive(Debug)]
pub struct Soundtrack {
    stream: Stream,
    /// Sample of the clip that is heard first, and number of samples that are heard.
    start: u32,
    length: u32,
    position: Option<[f32; 3]>,
    report: SoundReport,
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
    /// Encodes the sound of a clip or a take of `duration_s` seconds. What lies outside it is left out.
    ///
    /// # Errors
    /// [`Fault::Usage`] if ffmpeg is missing; [`Fault::Data`] if the file has no sound that it can decode, or none
    /// within the clip.
    pub fn encode(source: &SoundSource, duration_s: f64) -> Result<Soundtrack, Fault> {
        let bad = |what: String| Fault::Data(format!("{}: {what}", source.path.display()));
        let end = (duration_s * f64::from(SOUND_RATE_HZ)).round();
        if !(1.0..f64::from(u32::MAX)).contains(&end) {
            return Err(bad(format!("a clip of {duration_s} s can have no sound; leave --audio out")));
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

/// The package with this sound, in place of the one that it has.
pub(crate) fn put(package: &[u8], sound: Option<&Sound>, path: &Path) -> Result<Vec<u8>, Fault> {
    codec::with_sound(package, sound)
        .map_err(|error| Fault::Data(format!("{}: {error}; leave --audio out", path.display())))
}
