//! [`RingOutput`]: the callback of the audio device: takes frames from the ring, fades, places, and says what is heard.
//!
//! It runs on a thread that must never wait: it neither locks nor allocates, and a ring that is empty is silence.

use std::sync::Arc;

use rtrb::Consumer;

use super::binaural::BinauralOutput;
use super::link::{Heard, Link};
use super::packets::Frame;
use super::placing::{Placement, Placing};

/// Seconds of a fade.
const FADE_S: f32 = 0.005;

/// Largest sample: as 1 itself would overflow in formats of 24 bits.
const SAMPLE_MAX: f32 = 1.0 - f32::EPSILON / 2.0;

/// The end of the ring at the device.
pub(super) struct RingOutput {
    ring: Consumer<Frame>,
    link: Arc<Link>,
    rate_hz: u32,
    /// Number of the next frame of the ring.
    index: u64,
    /// Length of a fade in frames.
    fade: usize,
    /// Frames since the sound began after silence, up to `fade`.
    faded_in: usize,
    /// The frame before, from which the sound fades out if no other comes.
    last: Frame,
    gain: f32,
    placing: Placing,
}

impl RingOutput {
    /// The callback of a device. `placed` is where the output of a [`super::binaural::BinauralSource`] arrives.
    pub(super) fn new(
        ring: Consumer<Frame>,
        placed: Consumer<BinauralOutput>,
        link: Arc<Link>,
        rate_hz: u32,
    ) -> RingOutput {
        let fade = ((FADE_S * rate_hz as f32) as usize).max(1);
        RingOutput {
            ring,
            gain: link.gain(),
            link,
            rate_hz,
            index: 0,
            fade,
            faded_in: 0,
            last: [0.0; 2],
            placing: Placing::new(placed, rate_hz),
        }
    }

    /// Fills `out`, frames of `channels` samples of the type that `convert` makes of [-1, 1). It is asked for at `now_s`
    /// seconds and heard `latency_s` later.
    pub(super) fn render<S: Copy>(
        &mut self,
        out: &mut [S],
        convert: impl Fn(f32) -> S,
        channels: usize,
        now_s: f64,
        latency_s: f64,
    ) {
        let channels = channels.max(1);
        let count = out.len() / channels;
        let (target, placement) = (self.link.gain(), self.link.placement());
        let latency_s = latency_s + self.placing.begin(placement);
        let skipped = self.skip(out, &convert, channels, target, placement);
        let first = self.index;
        for samples in out.chunks_exact_mut(channels).skip(skipped) {
            let frame = match self.ring.pop() {
                Ok(frame) => {
                    self.index += 1;
                    self.fade_in(frame)
                }
                Err(_) => self.fall_silent(),
            };
            spread(self.placed(frame, target, placement), samples, &convert);
        }
        let at_s = now_s + latency_s + skipped as f64 / f64::from(self.rate_hz);
        debug_assert!(skipped <= count);
        self.link.set_heard(Heard { index: first, at_s, count: (self.index - first) as u32 });
    }

    /// Fades out what is to be dropped, and drops it. Returns the number of frames of `out` that this took.
    fn skip<S: Copy>(
        &mut self,
        out: &mut [S],
        convert: impl Fn(f32) -> S,
        channels: usize,
        target: f32,
        placement: Placement,
    ) -> usize {
        // Read once: a further start between would leave frames of the ring that no skip drops.
        let skip_to = self.link.skip_to();
        let dropped = skip_to.saturating_sub(self.index);
        if dropped == 0 {
            return 0;
        }
        let there = usize::try_from(dropped).unwrap_or(usize::MAX).min(self.ring.slots());
        let faded = there.min(self.fade).min(out.len() / channels);
        for (i, samples) in out.chunks_exact_mut(channels).take(faded).enumerate() {
            let Ok(frame) = self.ring.pop() else { break };
            let left = 1.0 - (i + 1) as f32 / faded as f32;
            self.index += 1;
            let frame = self.fade_in(frame).map(|x| x * left);
            spread(self.placed(frame, target, placement), samples, &convert);
        }
        if let Ok(chunk) = self.ring.read_chunk(there - faded) {
            chunk.commit_all();
        }
        // Frames before it that are not in the ring will never be.
        self.index = skip_to.max(self.index);
        (self.faded_in, self.last) = (0, [0.0; 2]);
        faded
    }

    fn fade_in(&mut self, frame: Frame) -> Frame {
        self.last = frame;
        if self.faded_in < self.fade {
            self.faded_in += 1;
            self.last = frame.map(|x| x * self.faded_in as f32 / self.fade as f32);
        }
        self.last
    }

    /// The next frame where the ring is empty.
    fn fall_silent(&mut self) -> Frame {
        self.faded_in = 0;
        // To a thousandth in the length of a fade.
        self.last = self.last.map(|x| x * (1.0 - 7.0 / self.fade.max(8) as f32));
        self.last
    }

    /// A frame as it is heard: placed, at the gain, within [-1, 1).
    fn placed(&mut self, frame: Frame, target: f32, placement: Placement) -> Frame {
        self.gain += (target - self.gain) / self.fade as f32;
        self.placing.place(frame, placement).map(|x| (x * self.gain).clamp(-1.0, SAMPLE_MAX))
    }
}

/// Writes a frame to all channels of the device: left and right, or their mean to the only one.
fn spread<S: Copy>(frame: Frame, samples: &mut [S], convert: impl Fn(f32) -> S) {
    samples.fill(convert(0.0));
    match samples {
        [both] => *both = convert(0.5 * (frame[0] + frame[1])),
        [left, right, ..] => (*left, *right) = (convert(frame[0]), convert(frame[1])),
        [] => {}
    }
}
