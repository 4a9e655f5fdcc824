//! [`Stream`]: packets of Opus, encoded by ffmpeg.

use std::io::Cursor;
use std::path::Path;
use std::process::Stdio;

use codec::SOUND_RATE_HZ;
use ogg::PacketReader;
use program::Fault;

use super::samples::Samples;
use crate::ffmpeg::Feeding;

/// Samples of a packet: 20 ms, the encoder's default.
pub(super) const PACKET_SAMPLES: u16 = 960;

/// Bits a second for each channel: transparent for speech and nearly so for music.
const BITS_PER_CHANNEL: u32 = 64_000;

/// Samples of silence behind the last one, so that the encoder gives it out.
const PADDING: usize = 2 * PACKET_SAMPLES as usize;

/// Packets of one encoder, one after another.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stream {
    pub(super) channels: u8,
    /// Number of samples that the decoder is late.
    pub(super) pre_skip: u16,
    pub(super) packets: Vec<Vec<u8>>,
    /// Number that tells it from others.
    pub(super) number: u32,
}

impl Stream {
    /// Encodes the first `count` samples. Messages name `path`.
    ///
    /// # Errors
    /// [`Fault::Usage`] if ffmpeg is missing, or has no encoder for Opus.
    pub(super) fn encode(samples: &Samples, count: usize, path: &Path) -> Result<Stream, Fault> {
        let channels = samples.channels();
        let bad = |what: String| {
            Fault::Usage(format!("ffmpeg cannot encode Opus: {what}; install one with libopus"))
        };
        let bits = (BITS_PER_CHANNEL * u32::from(channels)).to_string();
        let out = tempfile::Builder::new().suffix(".opus").tempfile();
        let out = out.map_err(|error| Fault::Usage(format!("no temporary file for sound: {error}")))?;
        let mut feeding = Feeding::start("ffmpeg", |command| {
            command.args(["-v", "error", "-f", "f32le", "-ar", &SOUND_RATE_HZ.to_string(), "-ac"]);
            command.args([&channels.to_string(), "-i", "-", "-c:a", "libopus", "-b:a", &bits]);
            command.args(["-frame_duration", "20", "-application", "audio", "-map_metadata", "-1", "-y"]);
            command.args(["-f", "ogg"]).arg(out.path()).stdout(Stdio::null());
        })?;
        let silence = vec![0; 4 * usize::from(channels) * PADDING];
        let mut feed = |part: &[u8]| {
            if feeding.has_ended() {
                return Ok(());
            }
            feeding.write(part).map_err(|error| Fault::Usage(format!("no pipe to ffmpeg: {error}")))
        };
        samples.read(count, &mut feed)?;
        feed(&silence)?;
        feeding.finish(path).map_err(bad)?;
        let bytes = std::fs::read(out.path()).map_err(|error| bad(error.to_string()))?;
        Stream::of_ogg(&bytes, channels, count).map_err(bad)
    }

    /// The packets of an Ogg file that hold `count` samples.
    fn of_ogg(bytes: &[u8], channels: u8, count: usize) -> Result<Stream, String> {
        let mut reader = PacketReader::new(Cursor::new(bytes));
        let mut next = || reader.read_packet().map_err(|error| error.to_string());
        let head = next()?.ok_or("it wrote nothing")?.data;
        let is_head =
            head.len() >= 19 && head.starts_with(b"OpusHead") && head[9] == channels && head[18] == 0;
        if !is_head {
            return Err("its file has another head".into());
        }
        let pre_skip = u16::from_le_bytes([head[10], head[11]]);
        // The comments.
        next()?;
        let needed = (usize::from(pre_skip) + count).div_ceil(PACKET_SAMPLES.into());
        let (mut packets, mut hash) = (Vec::with_capacity(needed), flate2::Crc::new());
        while packets.len() < needed {
            let packet = next()?.ok_or("its file is too short")?.data;
            if packet.is_empty() || packet.len() > usize::from(u16::MAX) {
                return Err(format!("a packet of {} bytes", packet.len()));
            }
            hash.update(&packet);
            packets.push(packet);
        }
        Ok(Stream { channels, pre_skip, packets, number: hash.sum() })
    }

    /// Bytes of all packets.
    pub(super) fn bytes(&self) -> usize {
        self.packets.iter().map(Vec::len).sum()
    }
}
