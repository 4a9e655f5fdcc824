//! [`SoundTiming`]: the clock of the picture, from what is heard, and when to start and stop the sound.
//!
//! While a clip plays forward at its captured rate, a frame advances by what the device has played since the frame
//! before. The display's clock gives the steps and what is heard their sum: a difference is taken in within some frames,
//! so that neither the jitter of the device's callbacks is seen nor the drift of two clocks adds up. A picture waits for
//! sound that begins, and goes on without it if none comes; it does not wait again until some was heard.

use super::filler::{SoundCommand, Start};
use super::link::Link;
use super::track::SoundTrack;
use crate::clock::Clock;

/// Share of a difference that a frame takes in, and the most by which it is faster or slower for it.
const TAKES_IN: f64 = 0.1;
const FASTER_MAX: f64 = 0.05;

/// Differences in seconds above this are taken in at once.
const JUMP_S: f64 = 0.1;

/// Seconds that a picture waits for the sound, and for how long the sound is then left out.
const WAITS_S: f64 = 0.5;
const LEFT_OUT_S: f64 = 3.0;

/// Difference in seconds of two positions that are the same.
const SAME_S: f64 = 1e-3;

/// Seconds before the end in which what is ahead was already decoded as for another end.
const NEAR_END_S: f64 = 0.5;

/// Follows a clock with sound.
#[derive(Default)]
pub(super) struct SoundTiming {
    run: Option<TimedRun>,
    /// Number of the latest start.
    number: u64,
    /// Until when there is no sound, after it did not come.
    left_out_until_s: f64,
    /// Whether the device did not play what was started last: the picture does not wait for it again.
    is_doubted: bool,
    /// Whether the next start follows another clip without a break.
    follows: bool,
}

/// Sound that was started.
struct TimedRun {
    number: u64,
    holds: bool,
    /// Whether some of it was heard.
    is_heard: bool,
    loops: bool,
    /// Seconds by which frames advanced since the start.
    elapsed_s: f64,
    /// Where they left the clock.
    position_s: f64,
    /// Seconds for which frames have waited.
    held_s: f64,
}

/// When a frame is.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameTime {
    /// Seconds since the frame before, by the display's clock.
    pub(super) elapsed_s: f64,
    /// When it is seen, in seconds.
    pub(super) seen_at_s: f64,
}

impl SoundTiming {
    /// Takes in that another clip plays; if it `follows` the clip before, from where that clip ended.
    pub(super) fn change_track(&mut self, follows: bool) {
        self.follows = follows && self.run.is_some();
        if let Some(run) = &mut self.run {
            // No position is the same: the next frame starts it.
            run.position_s = f64::NAN;
        }
    }

    /// Seconds by which a frame advances `clock`, and what the sound thread is to do.
    pub(super) fn step(
        &mut self,
        clock: &Clock,
        is_scrubbing: bool,
        track: &SoundTrack,
        link: &Link,
        frame: FrameTime,
    ) -> (f64, Option<SoundCommand>) {
        let is_audible = link.is_open() && !track.is_empty() && frame.seen_at_s >= self.left_out_until_s;
        if !is_audible || !is_heard(clock, is_scrubbing) {
            self.follows &= self.run.is_none();
            return (frame.elapsed_s, self.run.take().map(|_| SoundCommand::Stop));
        }
        if self.run.as_ref().is_some_and(|run| run.is_heard && link.anchor().is_none()) {
            // The sound thread has stopped, as no frame came for a while.
            self.run = None;
        }
        let loops = clock.starts_over();
        let position_s = clock.position_s();
        let mut command = None;
        match &mut self.run {
            Some(run) if is_same(run.position_s, position_s, clock.duration_s()) => {
                let is_near_end = clock.duration_s() - position_s < NEAR_END_S;
                if run.loops != loops && !is_near_end {
                    run.loops = loops;
                    command = Some(SoundCommand::Loop(loops));
                } else if run.loops != loops {
                    command = Some(self.start(clock, track, frame, true));
                }
            }
            _ => {
                let holds = !std::mem::take(&mut self.follows);
                command = Some(self.start(clock, track, frame, holds));
            }
        }
        let elapsed_s = self.elapsed_s(link, frame);
        let Some(run) = &mut self.run else { return (frame.elapsed_s, Some(SoundCommand::Stop)) };
        run.elapsed_s += elapsed_s;
        run.position_s = position_s + elapsed_s;
        (elapsed_s, command)
    }

    /// What the sound thread is to do where no frame is shown.
    #[cfg(feature = "xr")]
    pub(super) fn stop(&mut self) -> Option<SoundCommand> {
        self.run.take().map(|_| SoundCommand::Stop)
    }

    /// What the sound thread is to do after the viewer's input of a frame: to be silent as
    /// soon as the clip pauses, which may be the last frame for long.
    #[cfg(feature = "window")]
    pub(super) fn rest(&mut self, clock: &Clock, is_scrubbing: bool) -> Option<SoundCommand> {
        if is_heard(clock, is_scrubbing) {
            return None;
        }
        self.follows &= self.run.is_none();
        self.run.take().map(|_| SoundCommand::Stop)
    }

    fn start(&mut self, clock: &Clock, track: &SoundTrack, frame: FrameTime, holds: bool) -> SoundCommand {
        self.number += 1;
        let holds = holds && !self.is_doubted;
        let (number, loops, position_s) = (self.number, clock.starts_over(), clock.position_s());
        self.run =
            Some(TimedRun { number, holds, is_heard: false, loops, elapsed_s: 0.0, position_s, held_s: 0.0 });
        SoundCommand::Start(Start {
            number,
            track: track.clone(),
            position_s,
            duration_s: clock.duration_s(),
            loops,
            holds,
            at_s: frame.seen_at_s - frame.elapsed_s,
        })
    }

    /// Seconds by which a frame advances while sound plays. Ends the run if none comes.
    fn elapsed_s(&mut self, link: &Link, frame: FrameTime) -> f64 {
        let Some(run) = &mut self.run else { return frame.elapsed_s };
        let heard_s = link.anchor().filter(|anchor| anchor.number == run.number).and_then(|anchor| {
            let index = link.heard()?.index_at(frame.seen_at_s, anchor.rate_hz);
            let since = index - anchor.index as f64;
            // Frames before it may be heard until its first.
            (since > 0.0).then(|| anchor.offset_s + since / f64::from(anchor.rate_hz))
        });
        let elapsed_s = match heard_s {
            None if run.holds => 0.0,
            None => frame.elapsed_s,
            Some(heard_s) => {
                let is_first = !std::mem::replace(&mut run.is_heard, true);
                self.is_doubted = false;
                let difference_s = heard_s - (run.elapsed_s + frame.elapsed_s);
                if difference_s.abs() > JUMP_S || is_first && run.holds {
                    (heard_s - run.elapsed_s).max(0.0)
                } else {
                    let most_s = FASTER_MAX * frame.elapsed_s;
                    frame.elapsed_s + (TAKES_IN * difference_s).clamp(-most_s, most_s)
                }
            }
        };
        let waits = elapsed_s <= 0.0 || heard_s.is_none();
        run.held_s = if waits { run.held_s + frame.elapsed_s } else { 0.0 };
        if run.held_s > WAITS_S {
            self.run = None;
            self.is_doubted = true;
            self.left_out_until_s = frame.seen_at_s + LEFT_OUT_S;
        }
        elapsed_s
    }
}

/// Whether sound is heard with what the clock does: running forward at the captured rate.
fn is_heard(clock: &Clock, is_scrubbing: bool) -> bool {
    let is_normal = clock.speed() == 1.0 && !clock.is_reversed() && clock.overrun_s().is_none();
    is_normal && !is_scrubbing && clock.is_advancing() && !clock.is_waiting()
}

/// Whether two positions are the same in a clip of `duration_s` seconds whose end may be its start.
fn is_same(a_s: f64, b_s: f64, duration_s: f64) -> bool {
    let difference_s = (a_s - b_s).abs() % duration_s;
    difference_s.min(duration_s - difference_s) < SAME_S
}
