//! [`Video`]: the video of a camera, whose frames `ffmpeg` decodes when they are needed.
//!
//! ```text
//! ffprobe: size, colour matrix, presentation time of each frame
//! ffmpeg:  seeks to a frame, and decodes it and those after it to a pipe -> pictures, as PPM
//! ```
//!
//! Frames in ascending order come from one run of `ffmpeg`. It waits at the pipe until the next one is wanted.

use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Stdio};
use std::sync::Mutex;

use image::RgbImage;
use program::Fault;
use serde::{Deserialize, Serialize};

use super::image_file::{bad, lfs_pointer};
use crate::ffmpeg::{self, ProbedStream, Running};
use crate::messages::unreadable;

/// Longest row of frames that are decoded to reach one, rather than to seek it.
const SKIPPED_MAX: usize = 48;

/// Deviation that counts as rounding: ffprobe writes microseconds.
const ON_TIME_S: f64 = 1e-6;

/// The same in intervals of the capture.
const ROUNDING: f64 = 1e-3;

/// Rows of pixels from which a video that states no colour matrix has HDTV's, as players assume.
const HD_ROWS: u32 = 720;

/// A video file and the times of its frames.
#[derive(Debug)]
pub(crate) struct Video {
    path: PathBuf,
    /// Width and height of its pictures, upright.
    pub(crate) size: (u32, u32),
    /// Presentation times in seconds since the first frame's, strictly ascending.
    pub(crate) times_s: Vec<f64>,
    /// Presentation time of the first frame, in seconds since the start of the file.
    pub(crate) first_s: f64,
    /// Name in ffmpeg of the matrix by which its colours were made.
    matrix: &'static str,
    pub(crate) unusual: UnusualPictures,
    /// What ffprobe says of its pictures.
    pub(crate) stream: ProbedStream,
    decoding: Mutex<Option<Decoding>>,
}

/// What a video states of its pictures that is not followed: they are shown as they are.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnusualPictures {
    /// Name of the transfer function, if it is of high dynamic range.
    pub high_range: Option<String>,
    /// Name of the primaries, if they are not those of SDTV or HDTV and the range is not high.
    pub primaries: Option<String>,
    /// Order of the fields as ffprobe names it, if the pictures are interlaced.
    pub field_order: Option<String>,
}

impl UnusualPictures {
    fn of(stream: &ProbedStream) -> UnusualPictures {
        let high_range = stream.color_transfer.as_deref().and_then(high_range);
        let primaries =
            stream.color_primaries.as_deref().filter(|_| high_range.is_none()).and_then(primaries);
        let field_order = stream.field_order.clone();
        UnusualPictures {
            high_range: high_range.map(str::to_owned),
            primaries: primaries.map(str::to_owned),
            field_order: field_order.filter(|order| ["tt", "bb", "tb", "bt"].contains(&order.as_str())),
        }
    }
}

impl Video {
    /// Reads the times of the frames of a video file.
    ///
    /// # Errors
    /// [`Fault::Usage`] if there is no `ffprobe`, [`Fault::Data`] if the file has no video that it can read.
    pub(crate) fn open(path: &Path) -> Result<Video, Fault> {
        std::fs::metadata(path).map_err(|error| unreadable(path, &error))?;
        lfs_pointer(path).map_or(Ok(()), Err)?;
        let entries = "stream=width,height,color_space,color_transfer,color_primaries,field_order,codec_name,nb_frames:\
                       stream_side_data=rotation:packet=pts_time,flags:format=start_time";
        let mut probed = ffmpeg::probed(path, &["-select_streams", "V:0", "-show_entries", entries])?;
        let Some(stream) = probed.streams.pop() else {
            return Err(match probed.error {
                None => bad(path, "it has no video; name a video file"),
                Some(error) => {
                    bad(path, format!("no video that ffmpeg can read: {error}; copy it again, or convert it"))
                }
            });
        };
        let first_packets = probed.packets.iter().filter(|packet| !packet.flags.contains('D'));
        let mut times_s: Vec<f64> =
            first_packets.filter_map(|packet| seconds(packet.pts_time.as_deref())).collect();
        times_s.sort_by(f64::total_cmp);
        times_s.dedup();
        let Some(first_s) = times_s.first().copied() else {
            return Err(bad(path, "no frame of its video has a time; convert it to MP4"));
        };
        times_s.iter_mut().for_each(|time_s| *time_s -= first_s);
        let turned = stream
            .side_data_list
            .iter()
            .any(|data| (data.rotation.unwrap_or(0.0) / 90.0).round() % 2.0 != 0.0);
        let (width, height) = (stream.width, stream.height);
        Ok(Video {
            path: path.to_owned(),
            size: if turned { (height, width) } else { (width, height) },
            times_s,
            first_s: first_s - seconds(probed.format.start_time.as_deref()).unwrap_or(0.0),
            matrix: matrix(stream.color_space.as_deref(), height.min(width)),
            unusual: UnusualPictures::of(&stream),
            stream,
            decoding: Mutex::new(None),
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The video's frame that is nearest to each frame of a capture with `frames` frames, `fps` in a second, and the
    /// seconds by which it is later; none where the nearest is half an interval away or nearer to another. The first
    /// frame of the video is at `start_s`.
    pub(crate) fn at_frames(&self, start_s: f64, frames: usize, fps: f64) -> Vec<Option<(u32, f64)>> {
        let mut nearest: Vec<Option<(u32, f64)>> = vec![None; frames];
        for (number, time_s) in (0..).zip(&self.times_s) {
            let at = (start_s + time_s) * fps;
            // Frames half an interval late all count for the next, however their times are rounded.
            let frame = (at + 0.5 + ROUNDING).floor();
            if !(0.0..frames as f64).contains(&frame) {
                continue;
            }
            let late_s = (at - frame) / fps;
            let slot = &mut nearest[frame as usize];
            if slot.is_none_or(|(_, other_s)| late_s.abs() < other_s.abs()) {
                *slot = Some((number, if late_s.abs() < ON_TIME_S { 0.0 } else { late_s }));
            }
        }
        nearest
    }

    /// The picture of a frame; cheapest in ascending order.
    ///
    /// # Errors
    /// [`Fault::Usage`] if there is no `ffmpeg`, [`Fault::Data`] if it cannot decode the frame.
    ///
    /// # Panics
    /// If the video has no such frame.
    pub(crate) fn frame(&self, frame: usize) -> Result<RgbImage, Fault> {
        assert!(frame < self.times_s.len(), "the video has {} frames", self.times_s.len());
        let mut decoding = self.decoding.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let is_near = |decoding: &Decoding| (decoding.next..=decoding.next + SKIPPED_MAX).contains(&frame);
        let mut current = match decoding.take().filter(is_near) {
            Some(current) => current,
            None => self.decode_from(frame)?,
        };
        let (width, height) = self.size;
        let header = format!("P6\n{width} {height}\n255\n");
        let mut pixels = vec![0; width as usize * height as usize * 3];
        while current.next <= frame {
            match current.read(header.as_bytes(), &mut pixels) {
                Ok(true) => {}
                Ok(false) => {
                    let what =
                        "ffmpeg decodes pictures of another size, as where it crops; convert the video";
                    return Err(bad(&self.path, format!("{width}x{height} pixels by ffprobe, and {what}")));
                }
                Err(error) => return Err(self.undecoded(current, &error)),
            }
        }
        // Nothing waits for frames that are not there.
        *decoding = Some(current).filter(|current| current.next < self.times_s.len());
        Ok(RgbImage::from_raw(width, height, pixels).expect("as many bytes as pixels have"))
    }

    /// Runs ffmpeg from a frame on.
    fn decode_from(&self, frame: usize) -> Result<Decoding, Fault> {
        // Halfway from the frame before, so that no rounding of times misses it.
        let before = frame.checked_sub(1).map_or(0.0, |before| self.times_s[frame] - self.times_s[before]);
        let from_s = (self.first_s + self.times_s[frame] - 0.5 * before).max(0.0);
        let scale = format!(
            "scale=in_color_matrix={}:flags=accurate_rnd+full_chroma_int+full_chroma_inp",
            self.matrix
        );
        let mut running = Running::start("ffmpeg", |command| {
            command.args(["-nostdin", "-v", "error", "-threads", "2", "-ss", &format!("{from_s:.6}"), "-i"]);
            command.arg(&self.path).args(["-map", "0:V:0", "-fps_mode", "passthrough"]);
            command.args(["-vf", &scale, "-pix_fmt", "rgb24", "-c:v", "ppm", "-f", "image2pipe", "-"]);
            command.stdout(Stdio::piped());
        })?;
        let pictures = running.take_stdout();
        Ok(Decoding { running, pictures, next: frame })
    }

    /// The fault of a frame that ffmpeg did not write.
    fn undecoded(&self, mut current: Decoding, error: &std::io::Error) -> Fault {
        let (frame, frames) = (current.next, self.times_s.len());
        let why = current.running.last_error(&self.path).unwrap_or_else(|| match error.kind() {
            ErrorKind::UnexpectedEof => "the video ends before".into(),
            _ => error.to_string(),
        });
        bad(
            &self.path,
            format!("ffmpeg cannot decode frame {frame} of {frames}: {why}; record or copy it again"),
        )
    }
}

/// A run of ffmpeg that decodes frames to a pipe.
#[derive(Debug)]
struct Decoding {
    running: Running,
    pictures: ChildStdout,
    /// Number of the next frame in the pipe.
    next: usize,
}

impl Decoding {
    /// Reads the next picture into `pixels`; false if it does not begin with `header`, as one of another size does.
    fn read(&mut self, header: &[u8], pixels: &mut [u8]) -> io::Result<bool> {
        let mut start = vec![0; header.len()];
        self.pictures.read_exact(&mut start)?;
        if start != header {
            return Ok(false);
        }
        self.pictures.read_exact(pixels)?;
        self.next += 1;
        Ok(true)
    }
}

fn seconds(text: Option<&str>) -> Option<f64> {
    text?.parse().ok().filter(|seconds: &f64| seconds.is_finite())
}

/// Name in the filter `scale` of a colour matrix that ffprobe names.
fn matrix(stated: Option<&str>, rows: u32) -> &'static str {
    match stated {
        Some("bt709") => "bt709",
        Some("bt470bg" | "smpte170m") => "bt601",
        Some("smpte240m") => "smpte240m",
        Some("fcc") => "fcc",
        Some("bt2020nc" | "bt2020c") => "bt2020",
        _ if rows >= HD_ROWS => "bt709",
        _ => "bt601",
    }
}

/// Name of a transfer function of high dynamic range that ffprobe names.
fn high_range(stated: &str) -> Option<&'static str> {
    match stated {
        "arib-std-b67" => Some("HLG"),
        "smpte2084" => Some("PQ"),
        _ => None,
    }
}

/// Name of primaries that ffprobe names, unless they are those of SDTV or HDTV, which hardly differ, or not known.
fn primaries(stated: &str) -> Option<&str> {
    match stated {
        "bt709" | "bt470bg" | "smpte170m" | "smpte240m" | "unknown" | "reserved" => None,
        "bt2020" => Some("BT.2020"),
        "smpte432" => Some("Display P3"),
        other => Some(other),
    }
}

/// Sentences about videos, by name, whose pictures are shown as they are.
pub(crate) fn picture_notes<'v>(
    videos: impl Iterator<Item = (&'v str, &'v UnusualPictures)> + Clone,
) -> Vec<String> {
    let note = |of: fn(&UnusualPictures) -> Option<&String>, what: &str| {
        let named = videos.clone().filter_map(|(name, unusual)| Some(format!("{name} ({})", of(unusual)?)));
        let named: Vec<String> = named.collect();
        (!named.is_empty()).then(|| format!("{}: {what}", named.join(", ")))
    };
    let notes = [
        note(
            |unusual| unusual.high_range.as_ref(),
            "high dynamic range is shown as it is, up to 80 of 255 levels off; convert these videos to BT.709, as ffmpeg \
             does with zscale and tonemap",
        ),
        note(
            |unusual| unusual.primaries.as_ref(),
            "these primaries are taken for those of BT.709; convert these videos to BT.709, as ffmpeg does with zscale",
        ),
        note(
            |unusual| unusual.field_order.as_ref(),
            "interlaced pictures are shown as combs of two instants; deinterlace these videos first, as ffmpeg does with \
             bwdif",
        ),
    ];
    notes.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A video with frames at these times.
    fn video(times_s: impl Iterator<Item = f64>) -> Video {
        Video {
            path: PathBuf::new(),
            size: (2, 2),
            times_s: times_s.collect(),
            first_s: 0.0,
            matrix: "bt709",
            unusual: UnusualPictures::default(),
            stream: ProbedStream::default(),
            decoding: Mutex::new(None),
        }
    }

    /// The video's frames at the frames of a capture with 25 a second, and how late they are in milliseconds.
    fn at_frames(video: &Video, start_s: f64, frames: usize) -> Vec<Option<(u32, i64)>> {
        let at = video.at_frames(start_s, frames, 25.0).into_iter();
        at.map(|at| at.map(|(number, late_s)| (number, (1e3 * late_s).round() as i64))).collect()
    }

    #[test]
    fn a_frame_has_the_nearest_one_of_the_video() {
        let even = video((0..4).map(|i| f64::from(i) / 25.0));
        assert_eq!(at_frames(&even, 0.0, 3), [Some((0, 0)), Some((1, 0)), Some((2, 0))]);
        assert_eq!(at_frames(&even, 0.08, 4), [None, None, Some((0, 0)), Some((1, 0))]);
        assert_eq!(at_frames(&even, -0.11, 3), [Some((3, 10)), None, None]);
        // Half an interval late: each frame once.
        assert_eq!(
            at_frames(&even, 0.02, 5),
            [None, Some((0, -20)), Some((1, -20)), Some((2, -20)), Some((3, -20))]
        );
        // Twice as many, and a gap.
        let fast = video((0..6).map(|i| f64::from(i) / 50.0));
        assert_eq!(at_frames(&fast, 0.0, 3), [Some((0, 0)), Some((2, 0)), Some((4, 0))]);
        let gap = video([0.0, 0.004, 0.038, 0.12].into_iter());
        assert_eq!(at_frames(&gap, 0.0, 4), [Some((0, 0)), Some((2, -2)), None, Some((3, 0))]);
        // ffprobe writes six digits.
        let rounded = video([0.0, 0.033333, 0.066667].into_iter());
        assert!(rounded.at_frames(0.0, 3, 30.0).iter().all(|at| at.is_some_and(|(_, late_s)| late_s == 0.0)));
    }

    #[test]
    fn what_ffprobe_says_of_colours_and_times_is_understood() {
        assert_eq!(
            [matrix(Some("smpte170m"), 1080), matrix(None, 1080), matrix(Some("unknown"), 576)],
            ["bt601", "bt709", "bt601"]
        );
        assert_eq!(
            [seconds(Some("1.5")), seconds(Some("N/A")), seconds(Some("nan")), seconds(None)],
            [Some(1.5), None, None, None]
        );
    }
}
