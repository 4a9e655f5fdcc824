//! Cuts a [`Soundtrack`] into the sounds of segments.
//!
//! Where segments overlap, the stream is cut at an end of a packet, so that a decoder that comes from the segment before
//! goes on without a seam. Where they abut, it is cut at the exact sample. Each part begins with the packets that prime a
//! decoder which begins there.

use std::collections::VecDeque;

use codec::{SOUND_RATE_HZ, Sound, SoundInfo};

use super::packets::PACKET_SAMPLES;
use super::soundtrack::Soundtrack;
use crate::segments::Span;

/// Packets that prime a decoder: 80 ms, as RFC 7845 has it.
const PRIMING_PACKETS: u64 = 4;

/// Samples of a packet.
const PACKET: u64 = PACKET_SAMPLES as u64;

/// A part of the sound for one segment: samples from the start of the clip or the take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SoundPart {
    segment: usize,
    from: u64,
    to: u64,
}

impl Soundtrack {
    /// The sound of a clip.
    pub(super) fn of_clip(&self) -> Sound {
        self.part(self.start.into(), u64::from(self.start) + u64::from(self.length), 0)
    }

    /// The sound of each segment of a take of these spans, in its order; `None` for those without. Every instant of sound
    /// that a segment shows is in one segment that shows it.
    pub(crate) fn of_segments(&self, take_s: f64, spans: &[Span]) -> Vec<Option<Sound>> {
        let mut sounds: Vec<Option<Sound>> = spans.iter().map(|_| None).collect();
        for SoundPart { segment, from, to } in self.parts(take_s, spans) {
            sounds[segment] = Some(self.part(from, to, samples(spans[segment].start_s)));
        }
        sounds
    }

    /// The parts of segments, one after another. A segment has the sound until its end, and then the shortest one that
    /// shows the instant. Where another one shows the last packet, the part ends with the packet before; a decoder then
    /// goes on without decoding anything twice.
    fn parts(&self, take_s: f64, spans: &[Span]) -> Vec<SoundPart> {
        let mut at = u64::from(self.start);
        let end = at + u64::from(self.length);
        let starts: Vec<i64> = spans.iter().map(|span| samples(span.start_s)).collect();
        let ends: Vec<u64> =
            spans.iter().map(|span| samples(span.end_s().min(take_s)).max(0) as u64).collect();
        // Segments that have not begun at `at`, in the order of their starts.
        let mut waiting: Vec<usize> = (0..spans.len()).collect();
        waiting.sort_by_key(|i| starts[*i]);
        let mut waiting = VecDeque::from(waiting);
        // Segments without a part that show the instant or the packet it is in, the shortest first.
        let mut open: Vec<usize> = Vec::new();
        let mut parts: Vec<SoundPart> = Vec::new();
        while at < end {
            while let Some(i) = waiting.pop_front_if(|i| starts[*i] <= at as i64) {
                let shortest_first =
                    |k: &usize| spans[*k].duration_s.total_cmp(&spans[i].duration_s).then(k.cmp(&i));
                open.insert(open.partition_point(|k| shortest_first(k).is_lt()), i);
            }
            let packet = self.cut_before(at);
            open.retain(|i| ends[*i] > packet);
            let to = |i: usize| {
                let (to, cut) = (ends[i], self.cut_before(ends[i]));
                let later = waiting.iter().take_while(|k| starts[**k] <= cut as i64);
                let shows_cut = |k: &usize| *k != i && starts[*k] <= cut as i64 && ends[*k] > cut;
                if to >= end {
                    end
                } else if open.iter().chain(later).any(shows_cut) {
                    cut
                } else {
                    to
                }
            };
            match open.iter().map(|i| to(*i)).position(|to| to > at) {
                Some(place) => {
                    let part = SoundPart { segment: open[place], from: at, to: to(open[place]) };
                    open.remove(place);
                    at = part.to;
                    parts.push(part);
                }
                None => {
                    // Nothing is shown here.
                    let Some(next) = waiting.front() else { break };
                    at = starts[*next] as u64;
                }
            }
        }
        parts
    }

    /// The last end of a packet that is not behind sample `at`.
    fn cut_before(&self, at: u64) -> u64 {
        let start = u64::from(self.start);
        let in_stream = at.saturating_sub(start) + u64::from(self.stream.pre_skip);
        let cut = in_stream / PACKET * PACKET;
        (start + cut).saturating_sub(self.stream.pre_skip.into()).max(start)
    }

    /// The sound of samples `from` to `to`, in the time of a segment that begins at sample `origin`.
    fn part(&self, from: u64, to: u64, origin: i64) -> Sound {
        let in_stream = from - u64::from(self.start) + u64::from(self.stream.pre_skip);
        let first = (in_stream / PACKET).saturating_sub(PRIMING_PACKETS);
        let info = SoundInfo {
            channels: self.stream.channels,
            position: self.position,
            stream: self.stream.number,
            start: u32::try_from(from as i64 - origin).expect("a part begins within its segment"),
            length: u32::try_from(to - from).expect("a part is shorter than the sound"),
            lead: u16::try_from(in_stream - first * PACKET).expect("a few packets"),
            packet_samples: PACKET_SAMPLES,
        };
        let packets = &self.stream.packets[first as usize..][..info.packet_count()];
        Sound::new(info, packets.iter().map(Vec::as_slice)).expect("a part keeps the rules of sounds")
    }
}

/// The sample at a time in seconds.
fn samples(seconds: f64) -> i64 {
    (seconds * f64::from(SOUND_RATE_HZ)).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sound::packets::Stream;
    use crate::sound::soundtrack::SoundReport;

    /// `seconds` of sound from sample `start` on.
    fn track(start: u32, seconds: f64) -> Soundtrack {
        let length = samples(seconds) as u32;
        let count = (length + 312).div_ceil(960);
        let packets = (0..count).map(|i| i.to_le_bytes().to_vec()).collect();
        Soundtrack {
            stream: Stream { channels: 1, pre_skip: 312, packets, number: 9 },
            start,
            length,
            position: None,
            report: SoundReport {
                file: "a.wav".into(),
                codec: "opus",
                channels: 1,
                rate_hz: SOUND_RATE_HZ,
                duration_s: seconds,
                bytes: 0,
                position: None,
                notes: Vec::new(),
            },
        }
    }

    fn span(start_s: f64, duration_s: f64) -> Span {
        Span { start_s, duration_s, level: 0 }
    }

    /// Number that a packet of [`track`] holds.
    fn number(packet: &[u8]) -> u32 {
        u32::from_le_bytes(packet.try_into().unwrap())
    }

    #[test]
    fn a_clip_has_all_of_it() {
        for start in [0, 4_800] {
            let sound = track(start, 1.0).of_clip();
            let info = sound.info();
            assert_eq!((info.start, info.length, info.lead), (start, 48_000, 312));
            assert_eq!(sound.packets().len(), 51);
        }
    }

    #[test]
    fn segments_that_overlap_share_the_sound_without_gap_or_overlap() {
        let grid = |levels: i32| {
            let mut spans = vec![span(0.0, 10.0)];
            for level in 0..levels {
                let unit = 2f64.powi(level);
                spans.extend((0..(10.0 / unit) as i32).map(|k| span(f64::from(k) * unit - 0.3, 2.0 * unit)));
            }
            spans
        };
        for (start, seconds, spans) in
            [(0, 10.0, grid(1)), (0, 10.0, grid(3)), (7_777, 8.2, grid(2)), (0, 10.0, vec![span(-1.0, 12.0)])]
        {
            let track = track(start, seconds);
            let parts = track.parts(10.0, &spans);
            assert_eq!(parts[0].from, u64::from(start));
            assert_eq!(parts.last().unwrap().to, u64::from(start) + samples(seconds) as u64);
            assert!(parts.windows(2).all(|pair| pair[0].to == pair[1].from), "{parts:?}");
            let sounds = track.of_segments(10.0, &spans);
            for (i, part) in parts.iter().enumerate() {
                let (sound, span) = (sounds[part.segment].as_ref().unwrap(), spans[part.segment]);
                let info = sound.info();
                assert_eq!(samples(span.start_s) + i64::from(info.start), part.from as i64);
                assert!(info.end() <= samples(span.duration_s) as u32, "within its segment");
                assert_eq!(info.lead, if i == 0 { 312 } else { 3_840 }, "{parts:?}");
                // The packet that holds the first sample that is heard.
                let first = number(sound.packet(usize::from(info.lead) / 960).unwrap());
                assert_eq!(u64::from(first), (part.from - u64::from(start) + 312) / 960);
                if let Some(next) = parts.get(i + 1) {
                    assert_eq!(
                        (u64::from(info.lead) + u64::from(info.length)) % 960,
                        0,
                        "ends with a packet"
                    );
                    let next = sounds[next.segment].as_ref().unwrap();
                    let last = number(sound.packets().last().unwrap());
                    assert_eq!(number(next.packet(4).unwrap()), last + 1);
                }
            }
        }
    }

    #[test]
    fn where_nothing_is_shown_there_is_no_sound() {
        let parts = track(0, 10.0).parts(10.0, &[span(0.0, 2.0), span(5.0, 2.0)]);
        assert_eq!(parts.len(), 2);
        assert!(parts[0].to <= 96_000 && (240_000..240_960).contains(&parts[1].from), "{parts:?}");
        assert!(parts[1].to <= 336_000 && parts[1].to > 335_000, "{parts:?}");
    }

    /// The work grows with the number of segments, not with a power of it.
    #[test]
    fn an_hour_of_segments_is_cut_at_once() {
        let spans: Vec<Span> = (0..3_600).map(|second| span(f64::from(second), 1.0)).collect();
        let parts = track(0, 3_600.0).parts(3_600.0, &spans);
        assert!(parts.iter().map(|part| part.segment).eq(0..3_600));
    }

    /// As `join` makes them.
    #[test]
    fn segments_that_abut_have_the_sound_without_a_hole() {
        let track = track(0, 9.0);
        let spans = [0.0, 3.0, 6.0].map(|start_s| Span { start_s, duration_s: 3.0, level: 0 });
        let ends: Vec<(u64, u64)> =
            track.parts(9.0, &spans).iter().map(|part| (part.from, part.to)).collect();
        assert_eq!(ends, [(0, 144_000), (144_000, 288_000), (288_000, 432_000)]);
        // Nothing is shown for a second.
        let apart = [0.0, 4.0].map(|start_s| Span { start_s, duration_s: 3.0, level: 0 });
        let ends: Vec<(u64, u64)> =
            track.parts(9.0, &apart).iter().map(|part| (part.from, part.to)).collect();
        assert_eq!(ends, [(0, 144_000), (192_000, 336_000)]);
    }
}
