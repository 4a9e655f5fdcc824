//! The options of `package` about sound.

use std::path::{Path, PathBuf};

use program::Fault;

use crate::capture::CaptureSound;
use crate::parse::three_numbers;
use crate::sound::{SoundSource, Soundtrack};

/// What `--audio` says to leave out the sound of a capture.
const NONE: &str = "none";

/// Options about sound.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Sound")]
pub(super) struct AudioOptions {
    /// Sound of the clip or the take: any file with sound that ffmpeg reads; none leaves out that of a capture, which is
    /// taken otherwise
    #[arg(long, value_name = "FILE|none")]
    audio: Option<PathBuf>,
    /// Second of the clip at which the file begins; below 0 for a file that begins before the clip
    #[arg(long, value_name = "S", requires = "audio", allow_negative_numbers = true, default_value_t = 0.0,
          value_parser = seconds)]
    audio_start: f64,
    /// Point of the scene from which the sound comes, in its axes and units; without one it is heard the same from
    /// everywhere
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = position)]
    audio_position: Option<[f32; 3]>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| seconds.abs() <= 1e6);
    seconds.ok_or_else(|| "a number of seconds, at most 1000000".into())
}

fn position(text: &str) -> Result<[f32; 3], String> {
    let position =
        three_numbers(text, ',').filter(|position: &[f32; 3]| position.iter().all(|x| x.is_finite()));
    position.ok_or_else(|| "three numbers with commas between them, as in 0,1.6,0".into())
}

impl AudioOptions {
    /// Checks the file before any work is done. With `is_list` there is none: it would be the sound of every take.
    ///
    /// # Errors
    /// [`Fault::Usage`] for a file with a list; the errors of [`Soundtrack::check`].
    pub(super) fn check(&self, is_list: bool) -> Result<(), Fault> {
        match self.audio.as_deref().filter(|path| *path != Path::new(NONE)) {
            Some(_) if is_list => Err(Fault::Usage(
                "--audio: one file cannot be the sound of every take of a list; give none, or package takes one by one"
                    .into(),
            )),
            Some(path) => Soundtrack::check(path),
            None if self.audio_start != 0.0 => {
                Err(Fault::Usage("--audio-start: there is no sound that begins then; leave it out".into()))
            }
            None => Ok(()),
        }
    }

    /// The sound of a clip or a take of `duration_s` seconds: the sound of the options, or of the capture, which has it
    /// from second `first_s` on.
    ///
    /// # Errors
    /// Those of [`Soundtrack::encode`]; [`Fault::Usage`] for a position without sound.
    pub(super) fn soundtrack(
        &self,
        capture: Option<(&CaptureSound, f64)>,
        duration_s: f64,
    ) -> Result<Option<Soundtrack>, Fault> {
        let position = self.audio_position;
        let source = match (&self.audio, capture) {
            (Some(path), _) if path != Path::new(NONE) => {
                SoundSource { path: path.clone(), start_s: self.audio_start, position }
            }
            (None, Some((sound, first_s))) => {
                SoundSource { path: sound.path.clone(), start_s: sound.start_s - first_s, position }
            }
            _ if position.is_some() => {
                let what = "--audio-position: there is no sound to place; name it with --audio";
                return Err(Fault::Usage(what.into()));
            }
            _ => return Ok(None),
        };
        Soundtrack::encode(&source, duration_s).map(Some)
    }
}
