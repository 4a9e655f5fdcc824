//! [`Samples`]: the samples of a sound file, decoded by ffmpeg to a scratch file and repaired.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::process::Stdio;

use codec::SOUND_RATE_HZ;
use program::{Fault, counted};

use super::source::SoundSource;
use crate::ffmpeg::{self, Running};
use crate::messages::{decimal, unreadable};

/// Bytes of a sample: binary32.
const SAMPLE_BYTES: usize = 4;

/// Seconds behind the end of the clip that are decoded to know whether the file goes on.
const MORE_S: f64 = 0.1;

/// Samples of one or two channels at [`SOUND_RATE_HZ`].
#[derive(Debug)]
pub(super) struct Samples {
    file: File,
    channels: u8,
    /// Number of samples of each channel within the clip.
    len: usize,
    is_longer: bool,
    /// Factor that brings the loudest sample to full scale, 1 if it is not above.
    gain: f32,
    notes: Vec<String>,
}

impl Samples {
    /// Decodes what lies within a clip of `duration_s` seconds.
    ///
    /// # Errors
    /// [`Fault::Usage`] without ffmpeg or a scratch file; [`Fault::Data`] if there is no sound that it can decode.
    pub(super) fn decode(source: &SoundSource, duration_s: f64) -> Result<Samples, Fault> {
        let path = &source.path;
        let bad = |what: String| Fault::Data(format!("{}: {what}", path.display()));
        let of_file = probe(path)?;
        let channels: u8 = if of_file == 1 || source.position.is_some() { 1 } else { 2 };
        let mut notes = Vec::new();
        if of_file > u32::from(channels) {
            let to = if channels == 1 { "one, as sound from a point is" } else { "stereo" };
            notes.push(format!("{of_file} channels were mixed to {to}"));
        }
        let skipped_s = (-source.start_s).max(0.0);
        let most_s = duration_s - source.start_s.max(0.0) + MORE_S;
        let mut running = Running::start("ffmpeg", |command| {
            command.args(["-nostdin", "-v", "error", "-i"]).arg(path);
            // Silence where the track starts late or has gaps, so that a sample's number is its time.
            let filter = format!("aresample=async=1:first_pts=0,atrim=start={skipped_s}:duration={most_s}");
            command.args(["-map", "0:a:0", "-af", &filter, "-ac", &channels.to_string()]);
            command.args(["-ar", &SOUND_RATE_HZ.to_string(), "-f", "f32le", "-"]).stdout(Stdio::piped());
        })?;
        let no_file = |error| Fault::Usage(format!("no temporary file for sound: {error}"));
        let mut file = tempfile::tempfile().map_err(no_file)?;
        let Written { count, peak, repaired } =
            write_finite(running.take_stdout(), &mut file).map_err(no_file)?;
        let ended = running.finish(path);
        let said = running.last_error(path);
        let decoded = count / usize::from(channels);
        if decoded == 0 && source.start_s >= 0.0 {
            let said = said.unwrap_or_else(|| "its sound track is empty".into());
            return Err(bad(format!("no sound in it can be decoded: {said}; convert it to WAV")));
        }
        if let Err(said) = ended {
            return Err(bad(format!(
                "ffmpeg did not decode it to its end: {said}; try again, or convert it to WAV"
            )));
        }
        if let Some(said) = said {
            notes.push(format!("a part of it could not be decoded and is silent: {said}"));
        }
        if repaired > 0 {
            let samples = counted(repaired, "sample");
            notes.push(format!("{samples} not a finite number: now silence"));
        }
        if peak > 1.0 {
            let quieter = decimal(20.0 * f64::from(peak).log10(), 1);
            notes.push(format!("{quieter} dB quieter, as it was louder than full scale"));
        }
        let most = ((most_s - MORE_S) * f64::from(SOUND_RATE_HZ)).round() as usize;
        let is_longer = decoded > most + (MORE_S * f64::from(SOUND_RATE_HZ) / 2.0) as usize;
        let gain = if peak > 1.0 { 1.0 / peak } else { 1.0 };
        Ok(Samples { file, channels, len: decoded.min(most), is_longer, gain, notes })
    }

    /// Number of samples of each channel within the clip.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Seconds of sound within the clip.
    pub(super) fn duration_s(&self) -> f64 {
        self.len as f64 / f64::from(SOUND_RATE_HZ)
    }

    pub(super) fn channels(&self) -> u8 {
        self.channels
    }

    /// Whether the file goes on behind the end of the clip.
    pub(super) fn is_longer(&self) -> bool {
        self.is_longer
    }

    /// What was mixed or repaired.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Passes the first `count` samples of all channels to `part`, interleaved, piece by piece, as binary32.
    ///
    /// # Errors
    /// Those of `part`; [`Fault::Usage`] if the scratch file cannot be read.
    pub(super) fn read(
        &self,
        count: usize,
        mut part: impl FnMut(&[u8]) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        let lost = |error| Fault::Usage(format!("the temporary file of sound cannot be read: {error}"));
        let mut file = &self.file;
        file.seek(SeekFrom::Start(0)).map_err(lost)?;
        let mut left = count * usize::from(self.channels) * SAMPLE_BYTES;
        let mut piece = vec![0; 1 << 16];
        while left > 0 {
            let piece = &mut piece[..left.min(1 << 16)];
            file.read_exact(piece).map_err(lost)?;
            let (samples, _) = piece.as_chunks_mut::<SAMPLE_BYTES>();
            for sample in samples {
                *sample = (f32::from_le_bytes(*sample) * self.gain).to_le_bytes();
            }
            part(piece)?;
            left -= piece.len();
        }
        Ok(())
    }
}

/// What was written of samples.
#[derive(Default)]
struct Written {
    /// Number of samples, of all channels.
    count: usize,
    /// Largest magnitude.
    peak: f32,
    /// Number of samples that were not finite.
    repaired: usize,
}

/// Writes the samples that a decoder prints, with silence for those that are not finite.
fn write_finite(decoder: impl Read, file: &mut File) -> io::Result<Written> {
    let (mut decoder, mut writer) = (BufReader::new(decoder), BufWriter::new(file));
    let mut written = Written::default();
    let mut buffer = [0; SAMPLE_BYTES];
    while decoder.read_exact(&mut buffer).is_ok() {
        let mut sample = f32::from_le_bytes(buffer);
        if !sample.is_finite() {
            (sample, written.repaired) = (0.0, written.repaired + 1);
        }
        written.peak = written.peak.max(sample.abs());
        writer.write_all(&sample.to_le_bytes())?;
        written.count += 1;
    }
    writer.flush()?;
    Ok(written)
}

/// Number of channels of the first sound track of a file.
///
/// # Errors
/// [`Fault::Usage`] if ffmpeg is missing; [`Fault::Data`] if the file cannot be read or has no sound.
pub(super) fn probe(path: &Path) -> Result<u32, Fault> {
    std::fs::metadata(path).map_err(|error| unreadable(path, &error))?;
    let bad = |what: String| Fault::Data(format!("{}: {what}", path.display()));
    let said = ffmpeg::probed(path, &["-select_streams", "a:0", "-show_entries", "stream=channels"])?;
    match (said.streams.first().and_then(|stream| stream.channels), said.error) {
        (Some(channels), _) if channels > 0 => Ok(channels),
        (_, Some(error)) => Err(bad(format!("it is no sound that ffmpeg reads: {error}; convert it to WAV"))),
        _ => Err(bad("there is no sound in it; name another file, or leave --audio out".into())),
    }
}
