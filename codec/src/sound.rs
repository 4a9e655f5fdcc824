//! [`Sound`]: the sound of a clip, as packets of a codec that this crate does not decode.
//!
//! A section that is not critical holds it, before all others, so that it arrives with the first layer. Its times are
//! samples from clip time 0, so a segment keeps its sound at any start in a take. The packets before the first
//! sample that is heard prime the decoder: with them any segment can be the first one that plays.

use crate::{
    Contents, Error, Limits, SectionKind,
    bytes::Reader,
    error::FormatError,
    format::{SOUND_HEAD_BYTES, SOUND_PACKET_SAMPLES},
    limits::Budget,
};

/// Samples a second of every sound: the rate of the codec's own clock.
pub const SOUND_RATE_HZ: u32 = 48_000;

/// Codec of the packets: Opus (RFC 6716). Format.
const OPUS: u8 = 1;

/// Flag: the sound comes from a point of the scene. Format.
const HAS_POSITION: u8 = 1;

/// The sound of a clip: packets of Opus (RFC 6716), one after another.
#[derive(Clone, Debug, PartialEq)]
pub struct Sound {
    info: SoundInfo,
    /// End of each packet in `bytes`.
    ends: Vec<u32>,
    bytes: Vec<u8>,
}

/// What is known of a sound besides its packets. Times are in samples, [`SOUND_RATE_HZ`] a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoundInfo {
    /// Number of channels: 1 or 2, left then right.
    pub channels: u8,
    /// Point of the scene from which the sound comes, in the axes and units of the source; only with one channel.
    /// `None` for sound that is the same from everywhere.
    pub position: Option<[f32; 3]>,
    /// Number of the stream that the packets are a part of. Where one sound ends and another one of the same stream
    /// begins at this sample, a decoder goes on without priming.
    pub stream: u32,
    /// Time of the first sample that is heard, from clip time 0.
    pub start: u32,
    /// Number of samples that are heard, above 0. The end is below 2^32.
    pub length: u32,
    /// Number of samples before the first one that is heard. They prime the decoder.
    pub lead: u16,
    /// Number of samples in every packet: 120, 240, 480, 960, 1920 or 2880.
    pub packet_samples: u16,
}

impl SoundInfo {
    /// Number of packets: as many as the samples need.
    pub fn packet_count(&self) -> usize {
        let samples = u64::from(self.lead) + u64::from(self.length);
        samples.div_ceil(u64::from(self.packet_samples.max(1))) as usize
    }

    /// Time of the first sample behind those that are heard.
    pub fn end(&self) -> u32 {
        self.start.saturating_add(self.length)
    }

    /// Name and value of the first number out of range, with its offset in a section.
    fn check(&self) -> Result<(), (usize, &'static str, String)> {
        let check = |valid: bool, at, field, value: &dyn std::fmt::Debug| {
            if valid { Ok(()) } else { Err((at, field, format!("{value:?}"))) }
        };
        check(matches!(self.channels, 1 | 2), 1, "channels of the sound", &self.channels)?;
        let is_placed = self.position.is_some();
        check(!is_placed || self.channels == 1, 2, "channels of a sound with a position", &self.channels)?;
        let is_length = self.length > 0 && self.start.checked_add(self.length).is_some();
        check(is_length, 12, "length of the sound", &self.length)?;
        let known = SOUND_PACKET_SAMPLES.contains(&self.packet_samples);
        check(known, 18, "samples of a packet", &self.packet_samples)?;
        let is_finite = self.position.is_none_or(|position| position.iter().all(|x| x.is_finite()));
        check(is_finite, 20, "position of the sound", &self.position)
    }
}

impl Sound {
    /// Puts a sound together.
    ///
    /// # Errors
    /// Name and value of the first number out of range: of `info`, the number of packets, or the length of a packet,
    /// which is 1 to 65,535 bytes.
    pub fn new<'a>(
        info: SoundInfo,
        packets: impl ExactSizeIterator<Item = &'a [u8]>,
    ) -> Result<Sound, (&'static str, String)> {
        info.check().map_err(|(_, field, value)| (field, value))?;
        if packets.len() != info.packet_count() {
            return Err(("number of packets", packets.len().to_string()));
        }
        let (mut ends, mut bytes) = (Vec::with_capacity(packets.len()), Vec::new());
        for packet in packets {
            if !(1..=usize::from(u16::MAX)).contains(&packet.len()) {
                return Err(("length of a packet", packet.len().to_string()));
            }
            bytes.extend_from_slice(packet);
            let end = u32::try_from(bytes.len());
            ends.push(end.map_err(|_| ("bytes of the sound", bytes.len().to_string()))?);
        }
        Ok(Sound { info, ends, bytes })
    }

    /// Everything but the packets.
    pub fn info(&self) -> &SoundInfo {
        &self.info
    }

    /// Packet `index`, counted from 0; `None` behind the last one.
    pub fn packet(&self, index: usize) -> Option<&[u8]> {
        let end = *self.ends.get(index)? as usize;
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        self.bytes.get(start..end)
    }

    /// All packets in order.
    pub fn packets(&self) -> impl ExactSizeIterator<Item = &[u8]> {
        (0..self.ends.len()).map(|index| self.packet(index).unwrap_or_default())
    }

    /// Number of bytes in all packets.
    pub fn packet_bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Reads the payload of a section at `base`.
    fn read(payload: &[u8], base: usize, budget: &mut Budget) -> Result<Sound, Error> {
        let mut reader = Reader::new(payload, base, "sound");
        let codec = reader.u8()?;
        if codec != OPUS {
            return Err(Error::value(base, "codec of the sound", codec));
        }
        let (channels, flags, reserved) = (reader.u8()?, reader.u8()?, reader.u8()?);
        if flags & !HAS_POSITION != 0 || reserved != 0 {
            return Err(Error::value(base + 2, "flags of the sound", [flags, reserved]));
        }
        let (stream, start, length) = (reader.u32()?, reader.u32()?, reader.u32()?);
        let (lead, packet_samples) = (reader.u16()?, reader.u16()?);
        let point = reader.f32x3()?;
        let position = (flags & HAS_POSITION != 0).then_some(point);
        if position.is_none() && point.map(f32::to_bits) != [0; 3] {
            return Err(Error::value(base + 20, "position of a sound without one", point));
        }
        let info = SoundInfo { channels, position, stream, start, length, lead, packet_samples };
        info.check()
            .map_err(|(at, field, value)| Error::format(base + at, FormatError::Value { field, value }))?;
        let count = info.packet_count();
        // Every packet takes the bytes of its length and at least one of its own.
        if count.saturating_mul(3) > payload.len() - SOUND_HEAD_BYTES {
            return Err(Error::format(base + payload.len(), FormatError::Short { part: "sound" }));
        }
        let mut ends = budget.vec(count)?;
        let mut end = 0u32;
        for _ in 0..count {
            let at = reader.at();
            let length = reader.u16()?;
            if length == 0 {
                return Err(Error::value(at, "length of a packet", length));
            }
            // A section has less than 2^32 bytes, and the lengths are compared with them below.
            end = end.saturating_add(length.into());
            ends.push(end);
        }
        let packets = reader.take(end as usize)?;
        let mut bytes = budget.vec(packets.len())?;
        bytes.extend_from_slice(packets);
        reader.finish()?;
        Ok(Sound { info, ends, bytes })
    }
}

impl Contents {
    /// Reads the sound out of the package of this head, or out of a prefix that has its first layer; `None` if it has
    /// none.
    ///
    /// # Errors
    /// [`Error::Format`] if the section is damaged, or `bytes` ends before it does; [`Error::Limits`] if the sound takes
    /// more memory than `limits` allow, the section table included. The Gaussians of the package decode without it.
    pub fn sound(&self, bytes: &[u8], limits: &Limits) -> Result<Option<Sound>, Error> {
        let Some(section) = self.sections.iter().find(|section| section.kind == SectionKind::Sound) else {
            return Ok(None);
        };
        let mut budget = Budget::new(limits);
        budget.spend(size_of_val(&self.sections[..]))?;
        Sound::read(section.payload(bytes)?, section.offset, &mut budget).map(Some)
    }
}

#[cfg(feature = "encode")]
mod write {
    use super::*;
    use crate::{EncodeError, bytes::Writer, extra::with_extra, header::contents};

    impl Sound {
        /// The payload of a section.
        fn payload(&self) -> Vec<u8> {
            let SoundInfo { channels, position, stream, start, length, lead, packet_samples } = self.info;
            let mut w = Writer::default();
            w.u8(OPUS);
            w.u8(channels);
            w.u8(if position.is_some() { HAS_POSITION } else { 0 });
            w.u8(0);
            w.u32(stream);
            w.u32(start);
            w.u32(length);
            w.u16(lead);
            w.u16(packet_samples);
            w.f32x3(position.unwrap_or_default());
            self.packets().for_each(|packet| w.u16(packet.len() as u16));
            w.bytes.extend_from_slice(&self.bytes);
            w.bytes
        }
    }

    /// Returns the clip package with `sound` in place of its own sound, and without sound for `None`. All other
    /// sections stay as they are.
    ///
    /// # Errors
    /// - [`EncodeError::Package`] if `package` is not a whole clip package.
    /// - [`EncodeError::TooLarge`] if the result would exceed 4 GiB.
    pub fn with_sound(package: &[u8], sound: Option<&Sound>) -> Result<Vec<u8>, EncodeError> {
        let unlimited = Limits { max_gaussians: usize::MAX, max_bytes: usize::MAX };
        let head = contents(package, &unlimited).map_err(EncodeError::Package)?;
        with_extra(package, head, SectionKind::Sound, sound.map(Sound::payload).as_deref())
    }
}
#[cfg(feature = "encode")]
pub use write::with_sound;
