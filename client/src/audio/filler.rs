//! [`RingFiller`]: keeps the ring filled with what is heard next.
//!
//! It decodes a little ahead of the device. A start drops what is ahead, and the device fades over. In a loop it goes on
//! from the start by itself, so that the seam is where the picture's is.

use std::sync::Arc;

use codec::SOUND_RATE_HZ;
use rtrb::Producer;

use super::link::{Anchor, Link};
use super::packets::{EDGE, Frame, PacketReader};
use super::rate::{CHUNK, RateConverter};
use super::track::{SoundTrack, samples};

/// Seconds that are decoded ahead: twice the longest time that a busy system lets the sound thread wait.
const AHEAD_S: f64 = 0.08;

/// Seconds that the ring can hold: what is ahead, and as much again that was dropped and not yet taken.
pub(super) const RING_S: f64 = 0.4;

/// What the frame thread asks for.
pub(super) enum SoundCommand {
    /// Plays from a position.
    Start(Start),
    /// Plays on, but at the end as this says.
    Loop(bool),
    /// Falls silent.
    Stop,
}

/// Where to play from.
#[derive(Clone, Debug)]
pub(super) struct Start {
    /// Number of the start.
    pub(super) number: u64,
    pub(super) track: SoundTrack,
    pub(super) position_s: f64,
    pub(super) duration_s: f64,
    /// Whether the start follows the end.
    pub(super) loops: bool,
    /// Whether the picture waits for the sound; else the sound begins where the picture is by then.
    pub(super) holds: bool,
    /// When it was asked for, in seconds.
    pub(super) at_s: f64,
}

/// What is played.
struct Played {
    packets: PacketReader,
    /// Samples from the start of the first round, rounds included.
    at: i64,
    /// Where the packets are.
    expected: i64,
    /// Length of a round in samples, and whether there are several.
    duration: f64,
    loops: bool,
}

impl Played {
    /// Fills `out` with the next samples.
    fn read(&mut self, out: &mut [Frame]) {
        let mut rest = out;
        while !rest.is_empty() {
            let round = if self.loops { (self.at as f64 / self.duration).floor() } else { 0.0 };
            let mut bounds = [round, round + 1.0].map(|round| (round * self.duration).round() as i64);
            // Rounding may put the last sample of a round into the next.
            if self.loops && self.at >= bounds[1] {
                bounds = [round + 1.0, round + 2.0].map(|round| (round * self.duration).round() as i64);
            }
            let left = bounds[1] - self.at;
            let count = if left > 0 { rest.len().min(left as usize) } else { rest.len() };
            let part = &mut rest[..count];
            if left > 0 {
                let content = self.at - bounds[0];
                if content != self.expected {
                    self.packets.seek(content);
                }
                self.packets.read(part);
                self.expected = content + count as i64;
                self.fade(part, content, left);
            } else {
                part.fill([0.0; 2]);
            }
            self.at += count as i64;
            rest = &mut rest[count..];
        }
    }

    /// Fades at the seam of a round, `content` samples behind its start and `left` before its end.
    fn fade(&self, part: &mut [Frame], content: i64, left: i64) {
        for (i, frame) in (0..).zip(part) {
            let edge = (content + i + 1).min(left - i);
            if edge < EDGE {
                frame.iter_mut().for_each(|x| *x *= edge as f32 / EDGE as f32);
            }
        }
    }
}

/// The end of the ring at the sound thread.
pub(super) struct RingFiller {
    ring: Producer<Frame>,
    link: Arc<Link>,
    rate_hz: u32,
    /// Number of the next frame that is written.
    index: u64,
    played: Option<Played>,
    converter: Option<RateConverter>,
}

impl RingFiller {
    pub(super) fn new(ring: Producer<Frame>, link: Arc<Link>, rate_hz: u32) -> RingFiller {
        let converter = RateConverter::new(rate_hz);
        RingFiller { ring, link, rate_hz, index: 0, played: None, converter }
    }

    /// Whether something is played.
    pub(super) fn is_playing(&self) -> bool {
        self.played.is_some()
    }

    /// Carries out a command.
    pub(super) fn take(&mut self, command: SoundCommand) {
        match command {
            SoundCommand::Start(start) => self.start(start),
            SoundCommand::Loop(loops) => {
                if let Some(played) = &mut self.played {
                    // In the round under way.
                    played.at = (played.at as f64 % played.duration).round() as i64;
                    played.loops = loops;
                }
            }
            SoundCommand::Stop => {
                self.played = None;
                self.link.set_skip_to(self.index);
                self.link.set_anchor(None);
            }
        }
    }

    fn start(&mut self, start: Start) {
        let Start { number, track, position_s, duration_s, loops, holds, at_s } = start;
        // The next frame is heard behind those that the device has.
        let heard = self.link.heard().filter(|_| !holds);
        let end_s = heard.map(|heard| heard.at_s + f64::from(heard.count) / f64::from(self.rate_hz));
        let offset_s = end_s.map_or(0.0, |end_s| (end_s - at_s).clamp(0.0, RING_S));
        self.link.set_skip_to(self.index);
        let at = samples(position_s + offset_s);
        let duration = (duration_s * f64::from(SOUND_RATE_HZ)).max(1.0);
        let packets = PacketReader::new(track, at);
        self.played = Some(Played { packets, at, expected: at, duration, loops });
        if let Some(converter) = &mut self.converter {
            converter.restart();
        }
        let (index, rate_hz) = (self.index, self.rate_hz);
        self.link.set_anchor(Some(Anchor { number, index, offset_s, rate_hz }));
        self.fill();
    }

    /// Decodes until enough is ahead.
    pub(super) fn fill(&mut self) {
        let ahead = (AHEAD_S * f64::from(self.rate_hz)) as u64;
        let mut block = [[0.0; 2]; CHUNK];
        loop {
            let taken = self.ring.buffer().capacity() - self.ring.slots();
            // Frames that are to be dropped are not ahead.
            let waiting = (self.index - self.link.skip_to().min(self.index)).min(taken as u64);
            let room = CHUNK * self.rate_hz.div_ceil(SOUND_RATE_HZ) as usize + CHUNK;
            let Some(played) = &mut self.played else { return };
            if waiting >= ahead || self.ring.slots() < room {
                return;
            }
            played.read(&mut block);
            let (ring, index) = (&mut self.ring, &mut self.index);
            let mut push = |frame| {
                if ring.push(frame).is_ok() {
                    *index += 1;
                }
            };
            match &mut self.converter {
                Some(converter) => converter.convert(&block, push),
                None => block.iter().for_each(|frame| push(*frame)),
            }
        }
    }
}
