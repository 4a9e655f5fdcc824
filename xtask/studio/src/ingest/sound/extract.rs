//! Extracts the sound of a video as a file of samples, and reads parts of it.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use program::{Fault, output};
use serde_json::json;

use super::pair::RATE;
use crate::capture::bad;
use crate::ffmpeg::Running;
use crate::ingest::store::{Store, file_name, identity};
use crate::messages::unreadable;

/// Bytes of a sample: 16 bits, little-endian.
const SAMPLE_BYTES: u64 = 2;

/// The sound of a video, in a file. Its first sample is at the start of the video's file.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    path: PathBuf,
    /// Number of samples.
    pub(super) len: usize,
}

impl Track {
    /// Extracts the sound of `video`, unless an earlier run did, which the flag says.
    ///
    /// # Errors
    /// [`Fault::Usage`] if there is no ffmpeg; [`Fault::Data`] if it cannot decode the sound.
    pub(crate) fn extract(store: &Store, video: &Path) -> Result<(Track, bool), Fault> {
        let name = format!("sound-{}", file_name(&video.file_name().unwrap_or_default().to_string_lossy()));
        let path = store.path(&format!("{name}.s16"));
        let key = json!([identity(video)?, RATE]);
        let length = |path: &Path| std::fs::metadata(path).map(|file| file.len()).ok();
        let (bytes, is_kept) = store.result(&name, &key, || extract(video, &path))?;
        let (bytes, is_kept) = match length(&path) == Some(bytes) {
            true => (bytes, is_kept),
            // The samples were removed.
            false => (extract(video, &path)?, false),
        };
        Ok((Track { path, len: (bytes / SAMPLE_BYTES) as usize }, is_kept))
    }

    /// Seconds of sound.
    pub(super) fn duration_s(&self) -> f64 {
        self.len as f64 / RATE
    }

    /// `count` samples from number `from` on; 0 outside the track.
    ///
    /// # Errors
    /// [`Fault::Data`] if the file cannot be read.
    pub(super) fn samples(&self, from: i64, count: usize) -> Result<Vec<f32>, Fault> {
        let mut samples = vec![0.0; count];
        let first = from.clamp(0, self.len as i64);
        let end = (from + count as i64).clamp(first, self.len as i64);
        let mut bytes = vec![0; (end - first) as usize * SAMPLE_BYTES as usize];
        let read = File::open(&self.path).and_then(|mut file| {
            file.seek(SeekFrom::Start(first as u64 * SAMPLE_BYTES))?;
            file.read_exact(&mut bytes)
        });
        read.map_err(|error| unreadable(&self.path, &error))?;
        let (values, _) = bytes.as_chunks::<2>();
        let before = (first - from).clamp(0, count as i64) as usize;
        for (sample, value) in samples[before..].iter_mut().zip(values) {
            *sample = f32::from(i16::from_le_bytes(*value));
        }
        Ok(samples)
    }
}

/// Extracts the samples of a video to a file, and returns its length.
fn extract(video: &Path, to: &Path) -> Result<u64, Fault> {
    let running = Running::start("ffmpeg", |command| {
        command.args(["-nostdin", "-v", "error", "-i"]).arg(video);
        // Silence where the track starts late or has gaps, so that a sample's number is its time.
        command.args(["-map", "0:a:0", "-af", "aresample=async=1:first_pts=0", "-ac", "1", "-ar"]);
        command.args([&format!("{RATE}"), "-f", "s16le", "-"]).stdout(Stdio::piped());
    })?;
    write_samples(running, video, to)
}

/// Writes the samples that a run prints, and returns the length of their file; nothing if it does not succeed.
fn write_samples(mut running: Running, video: &Path, to: &Path) -> Result<u64, Fault> {
    let mut pipe = running.take_stdout();
    let mut total = 0;
    output::write_parts(to, |file| {
        let mut buffer = vec![0; 1 << 16];
        loop {
            match pipe.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => {
                    file.write(&buffer[..count])?;
                    total += count as u64;
                }
                Err(error) => return Err(bad(video, format!("its sound cannot be read: {error}"))),
            }
        }
        let whole =
            running.finish(video).and_then(|()| if total > 0 { Ok(()) } else { Err("it has none".into()) });
        whole.map_err(|said| {
            bad(video, format!("ffmpeg cannot decode its sound: {said}; state starts with --offsets FILE"))
        })
    })?;
    Ok(total)
}

impl Track {
    /// A track of these samples, for tests.
    #[cfg(test)]
    pub(super) fn from_samples(path: PathBuf, samples: &[f32]) -> Track {
        let bytes: Vec<u8> = samples.iter().flat_map(|x| (*x as i16).to_le_bytes()).collect();
        std::fs::write(&path, bytes).unwrap();
        Track { path, len: samples.len() }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_is_killed_leaves_no_samples() {
        let folder = tempfile::tempdir().unwrap();
        let to = folder.path().join("a.s16");
        let write = |script: &str| {
            let running = Running::start("sh", |command| {
                command.args(["-c", script]).stdout(Stdio::piped());
            });
            write_samples(running.unwrap(), Path::new("a.mp4"), &to).map_err(|fault| fault.to_string())
        };
        for (script, said) in [
            ("printf 1234; kill -9 $$", "signal: 9"),
            ("printf 1234; echo a.mp4: no memory >&2; exit 1", "its sound: no memory;"),
            ("true", "it has none"),
        ] {
            let error = write(script).unwrap_err();
            assert!(error.contains(said) && !to.exists(), "{error}");
        }
        assert_eq!((write("printf 1234"), std::fs::read(&to).unwrap()), (Ok(4), b"1234".to_vec()));
    }
}
