//! [`PacketReader`]: decodes the packets of a track into samples in order, from any sample on.

use codec::SOUND_RATE_HZ;
use rusty_opus::OpusDecoder;

use super::track::{Course, PlacedSound, SoundTrack};

/// A sample of both ears, left then right.
pub(super) type Frame = [f32; 2];

/// Samples that are decoded before the first one that is heard: 80 ms, as RFC 7845 asks for.
const PRIMING: i64 = SOUND_RATE_HZ as i64 * 80 / 1000;

/// Most samples of a packet that Opus knows: 120 ms.
const PACKET_SAMPLES_MAX: usize = 5_760;

/// Samples over which a sound fades in and out where it does not go on: 3 ms.
pub(super) const EDGE: i64 = SOUND_RATE_HZ as i64 * 3 / 1000;

/// Decodes a track from one sample after the other.
pub(super) struct PacketReader {
    track: SoundTrack,
    /// The next sample.
    at: i64,
    run: Option<Run>,
}

/// A sound that is being decoded.
struct Run {
    placed: PlacedSound,
    /// `None` if the library refuses one: all is silence then.
    decoder: Option<OpusDecoder>,
    next_packet: usize,
    /// Samples of the latest packet. The first `used` were taken.
    decoded: Vec<Frame>,
    used: usize,
    /// Sample at which it fades in; `None` if it continues the stream of the sound before.
    fades_from: Option<i64>,
    /// Whether another sound was known, when it was read last, that continues its stream.
    is_continued: bool,
}

impl PacketReader {
    /// Reads `track` from sample `at` on.
    pub(super) fn new(track: SoundTrack, at: i64) -> PacketReader {
        PacketReader { track, at, run: None }
    }

    /// Goes to sample `at`.
    pub(super) fn seek(&mut self, at: i64) {
        (self.at, self.run) = (at, None);
    }

    /// Fills `out` with the next samples: silence where no sound is, or none is loaded.
    pub(super) fn read(&mut self, out: &mut [Frame]) {
        let mut rest = out;
        while !rest.is_empty() {
            let count = self.read_part(rest);
            self.at += count as i64;
            rest = &mut rest[count..];
        }
    }

    /// Fills the beginning of `out` with samples of one sound, or with silence; returns how many.
    fn read_part(&mut self, out: &mut [Frame]) -> usize {
        let mut course = self.course();
        if course.is_none_or(|course| self.at >= course.until) {
            self.begin();
            course = self.course();
        }
        let (Some(run), Some(Course { until, is_continued })) = (&mut self.run, course) else {
            let until = self.track.next_after(self.at).unwrap_or(i64::MAX);
            let count = out.len().min(usize::try_from(until - self.at).unwrap_or(usize::MAX)).max(1);
            out[..count].fill([0.0; 2]);
            return count;
        };
        let left = usize::try_from(until - self.at).unwrap_or(0).max(1);
        let wanted = out.len().min(left);
        let count = run.take(&mut out[..wanted]);
        for (sample, frame) in (self.at..).zip(&mut out[..count]) {
            let mut gain = 1.0f32;
            if let Some(start) = run.fades_from {
                gain = gain.min((sample - start + 1) as f32 / EDGE as f32);
            }
            if !is_continued {
                gain = gain.min((until - sample) as f32 / EDGE as f32);
            }
            frame.iter_mut().for_each(|x| *x *= gain.max(0.0));
        }
        run.is_continued = is_continued;
        count
    }

    /// How the sound that is decoded goes on from the present sample.
    fn course(&self) -> Option<Course> {
        self.run.as_ref().map(|run| self.track.course(&run.placed, self.at))
    }

    /// Begins to decode the sound at the present sample, if there is one. The decoder goes on if the sound before and
    /// this one are parts of one stream.
    fn begin(&mut self) {
        let before = self.run.take();
        // One that has faded out is over.
        let is_over = |run: &&Run| run.is_continued && run.placed.end() == self.at;
        let follower = before.as_ref().filter(is_over).and_then(|run| self.track.follower(&run.placed));
        let joins = follower.is_some();
        let Some(placed) = follower.or_else(|| self.track.at(self.at)) else { return };
        let offset = self.at - placed.origin();
        let packet_samples = i64::from(placed.sound.info().packet_samples);
        let fades_from = match &before {
            _ if joins => None,
            Some(_) => Some(self.at),
            None => Some(placed.start),
        };
        if let Some(run) = before.filter(|run| joins && run.used == run.decoded.len())
            && offset % packet_samples == 0
        {
            let next_packet = (offset / packet_samples) as usize;
            let (decoder, decoded) = (run.decoder, Vec::new());
            self.run =
                Some(Run { placed, decoder, next_packet, decoded, used: 0, fades_from, is_continued: false });
            return;
        }
        let first = (offset - PRIMING).max(0) / packet_samples;
        let decoder = OpusDecoder::new(SOUND_RATE_HZ as i32, placed.sound.info().channels.into()).ok();
        let mut run = Run {
            placed,
            decoder,
            next_packet: first as usize,
            decoded: Vec::new(),
            used: 0,
            fades_from,
            is_continued: false,
        };
        run.skip((offset - first * packet_samples) as usize);
        self.run = Some(run);
    }
}

impl Run {
    /// Decodes and drops samples.
    fn skip(&mut self, mut count: usize) {
        while count > 0 {
            self.refill();
            let skipped = count.min(self.decoded.len() - self.used);
            self.used += skipped;
            count -= skipped;
        }
    }

    /// Fills the beginning of `out`; returns how much. At least one, if `out` is not empty.
    fn take(&mut self, out: &mut [Frame]) -> usize {
        self.refill();
        let count = out.len().min(self.decoded.len() - self.used);
        out[..count].copy_from_slice(&self.decoded[self.used..self.used + count]);
        self.used += count;
        count
    }

    /// Decodes the next packet if all samples of the latest were taken. A packet that does not decode is silence.
    fn refill(&mut self) {
        if self.used < self.decoded.len() {
            return;
        }
        let info = self.placed.sound.info();
        let channels = usize::from(info.channels);
        let wanted = usize::from(info.packet_samples);
        let mut samples = [0.0; 2 * PACKET_SAMPLES_MAX];
        // For no packet at all, the library would make something up.
        let packet = self.placed.sound.packet(self.next_packet).filter(|packet| !packet.is_empty());
        let count = self.decoder.as_mut().zip(packet).and_then(|(decoder, packet)| {
            decoder.decode(packet, PACKET_SAMPLES_MAX, &mut samples[..PACKET_SAMPLES_MAX * channels]).ok()
        });
        self.decoded.clear();
        if count == Some(wanted) {
            let frame = |samples: &[f32]| {
                [samples[0], samples[channels - 1]].map(|x| if x.is_finite() { x } else { 0.0 })
            };
            self.decoded.extend(samples[..wanted * channels].chunks_exact(channels).map(frame));
        } else {
            self.decoded.resize(wanted, [0.0; 2]);
        }
        (self.used, self.next_packet) = (0, self.next_packet + 1);
    }
}
