//! Encodes the pictures and the sound of a camera as H.264 and AAC in an MP4 file, by one run of ffmpeg.

use std::path::{Path, PathBuf};

use program::Fault;

use super::timing::{TICKS_PER_SECOND, Timing};
use crate::ffmpeg::Feeding;

/// Threads of the encoder, on which its bytes depend.
const THREADS: &str = "4";

/// A video whose pictures are being written.
#[derive(Debug)]
pub(super) struct Encoding {
    feeding: Feeding,
    /// Where it is written, and where it will be, for messages.
    path: PathBuf,
    shown: PathBuf,
}

/// How a video is encoded.
#[derive(Clone, Copy, Debug)]
pub(super) struct VideoFormat<'a> {
    /// Width and height as stored.
    pub(super) size: [u32; 2],
    /// Frames in 1000 seconds.
    pub(super) millifps: u32,
    pub(super) timing: &'a Timing,
    /// x264's constant rate factor.
    pub(super) crf: u8,
}

impl Encoding {
    /// Begins the video at `path`, in messages `shown`, with the sound of a WAV file.
    ///
    /// # Errors
    /// [`Fault::Usage`] if ffmpeg is not installed or cannot be run.
    pub(super) fn begin(
        path: &Path,
        shown: &Path,
        sound: &Path,
        format: &VideoFormat<'_>,
    ) -> Result<Encoding, Fault> {
        let [width, height] = format.size;
        let rate = format!("{}/1000", format.millifps);
        // Without these flags swscale rounds away some of the colours' accuracy. HDTV's matrix, as it is tagged.
        let scale = "scale=in_range=full:out_range=tv:out_color_matrix=bt709:\
             flags=accurate_rnd+full_chroma_int+full_chroma_inp,format=yuv420p";
        let filters = [format.timing.filter(), Some(scale.into())].into_iter().flatten();
        let filters = filters.collect::<Vec<String>>().join(",");
        // A key frame a second, as cameras have.
        let interval = format.millifps.div_ceil(1000).to_string();
        let feeding = Feeding::start("ffmpeg", |command| {
            command.args(["-nostdin", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
            // Without -r it rounds a rate to one that is common.
            command.args(["-s", &format!("{width}x{height}"), "-framerate", &rate, "-r", &rate]);
            command.args(["-i", "pipe:0", "-i"]);
            command.arg(sound).args(["-map", "0:v", "-map", "1:a", "-vf", &filters]);
            command.args([
                "-fps_mode",
                "passthrough",
                "-c:v",
                "libx264",
                "-preset",
                "medium",
                "-threads",
                THREADS,
            ]);
            command.args(["-crf", &format.crf.to_string(), "-g", &interval]);
            if format.timing.filter().is_some() {
                let ticks = TICKS_PER_SECOND.to_string();
                command.args(["-enc_time_base", &format!("1/{ticks}"), "-video_track_timescale", &ticks]);
            }
            for tag in ["-colorspace", "-color_primaries", "-color_trc"] {
                command.args([tag, "bt709"]);
            }
            command.args(["-color_range", "tv", "-c:a", "aac", "-b:a", "160k"]);
            // Neither the time nor the versions are in it.
            command.args(["-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact"]);
            command.args(["-flags:a", "+bitexact", "-f", "mp4", "-y"]).arg(path);
        })?;
        Ok(Encoding { feeding, path: path.to_owned(), shown: shown.to_owned() })
    }

    /// Appends a picture, 3 bytes a pixel. Returns whether ffmpeg takes more;
    /// if not, [`Encoding::failure`] says why.
    ///
    /// # Errors
    /// [`Fault::Usage`] if the pipe to ffmpeg fails.
    pub(super) fn write(&mut self, picture: &[u8]) -> Result<bool, Fault> {
        self.feeding.write(picture).map_err(|error| failed(&self.shown, &error.to_string()))?;
        Ok(!self.feeding.has_ended())
    }

    /// Ends the video.
    ///
    /// # Errors
    /// [`Fault::Usage`] if ffmpeg failed, with what it says.
    pub(super) fn finish(self) -> Result<(), Fault> {
        self.feeding.finish(&self.path).map_err(|why| failed(&self.shown, &why))
    }

    /// Why it ended before all pictures were written.
    pub(super) fn failure(self) -> Fault {
        let ended = self.feeding.finish(&self.path);
        failed(&self.shown, &ended.err().unwrap_or_else(|| "it took only a part of the pictures".into()))
    }
}

fn failed(path: &Path, why: &str) -> Fault {
    let needs = "it needs libx264, aac and space on the disk";
    Fault::Usage(format!("cannot write {}: ffmpeg ended ({why}); {needs}", path.display()))
}
