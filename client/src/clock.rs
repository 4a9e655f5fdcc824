//! [`Clock`]: position, speed, direction and loop of a playing clip, independent of any display.
//!
//! The caller advances it by elapsed time (wall time in a window, predicted display time in a headset, what was heard
//! while sound plays) and draws [`Clock::clip_time`]. Positions are seconds from the start of the clip.

/// Slowest and fastest speed.
pub const SPEED_RANGE: (f64, f64) = (0.1, 2.0);

/// Speeds of [`Clock::faster`] and [`Clock::slower`].
pub const SPEEDS: [f64; 8] = [0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0];

/// Tolerance within which two positions are the same frame, in frames.
const SAME_FRAME: f64 = 1e-3;

/// The playback state of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Clock {
    duration_s: f64,
    fps: f64,
    position_s: f64,
    playing: bool,
    looping: bool,
    speed: f64,
    reversed: bool,
    /// Whether another clip follows at the end.
    has_next: bool,
    /// Seconds of the clip by which the last step passed the end, if it waits there for the next clip.
    overrun_s: Option<f64>,
    /// Whether the clip started over, at its end if it plays backwards, since [`Clock::take_started_over`].
    started_over: bool,
    /// Whether the clip waits for what it shows next.
    waiting: bool,
}

impl Clock {
    /// A clip of `duration_s` seconds captured at `fps` frames per second, playing in a loop from its start.
    /// A duration or rate that is not positive and finite makes the clip a single image.
    pub fn new(duration_s: f64, fps: f64) -> Clock {
        let positive = |x: f64| if x.is_finite() && x > 0.0 { x } else { 0.0 };
        Clock {
            duration_s: positive(duration_s),
            fps: positive(fps),
            position_s: 0.0,
            playing: true,
            looping: true,
            speed: 1.0,
            reversed: false,
            has_next: false,
            overrun_s: None,
            started_over: false,
            waiting: false,
        }
    }

    /// Plays another clip forward from its start, with the same loop and speed.
    pub fn change_clip(&mut self, duration_s: f64, fps: f64) {
        let Clock { looping, speed, .. } = *self;
        *self = Clock { looping, speed, ..Clock::new(duration_s, fps) };
    }

    /// Continues with the next clip, at the overrun of this one.
    pub fn continue_with(&mut self, duration_s: f64, fps: f64) {
        let (overrun_s, playing) = (self.overrun_s.unwrap_or(0.0), self.playing);
        self.change_clip(duration_s, fps);
        self.position_s = overrun_s.min(self.duration_s);
        self.playing = playing;
    }

    /// Sets whether another clip follows. This one then waits for it at its end.
    pub fn set_has_next(&mut self, has_next: bool) {
        self.has_next = has_next;
        self.overrun_s = self.overrun_s.filter(|_| has_next);
    }

    /// Sets whether the clip waits, while it plays, for what its position shows. Time spent waiting does not count.
    pub fn set_waiting(&mut self, waiting: bool) {
        self.waiting = waiting;
    }

    /// Whether the clip plays and waits for what its position shows.
    pub fn is_waiting(&self) -> bool {
        self.waiting && self.is_advancing()
    }

    /// Seconds of the clip by which the last step passed the end; `None` unless the clip waits there for the
    /// next one.
    pub fn overrun_s(&self) -> Option<f64> {
        self.overrun_s
    }

    /// Whether the clip started over since the last call.
    pub fn take_started_over(&mut self) -> bool {
        std::mem::take(&mut self.started_over)
    }

    /// Advances by `elapsed_s` seconds of real time. At its end, a clip waits for the next one if there is
    /// one; otherwise it starts over if it loops, and stops if not. Backwards, a clip that comes to its start goes on
    /// from its end if it loops, and stops if not; no clip follows there.
    pub fn advance(&mut self, elapsed_s: f64) {
        if !self.is_advancing() || self.waiting || !elapsed_s.is_finite() || elapsed_s <= 0.0 {
            return;
        }
        let step = elapsed_s * self.speed;
        if self.reversed {
            return self.go_back(step);
        }
        let position = self.position_s + step;
        if position < self.duration_s {
            self.position_s = position;
        } else if self.has_next {
            // Time spent waiting at the end does not count.
            self.overrun_s = Some(self.overrun_s.map_or(position - self.duration_s, |_| 0.0));
            self.position_s = self.duration_s;
        } else if self.looping {
            self.position_s = position % self.duration_s;
            self.started_over = true;
        } else {
            self.position_s = self.duration_s;
            self.playing = false;
        }
    }

    fn go_back(&mut self, step_s: f64) {
        let position = self.position_s - step_s;
        if position >= 0.0 {
            self.position_s = position;
        } else if self.looping {
            self.position_s = position.rem_euclid(self.duration_s);
            self.started_over = true;
        } else {
            self.position_s = 0.0;
            self.playing = false;
        }
    }

    /// Plays or pauses. Playing from the end starts over, and backwards from the start.
    pub fn set_playing(&mut self, playing: bool) {
        let is_over = match self.reversed {
            true => self.position_s <= 0.0,
            false => self.position_s >= self.duration_s,
        };
        if playing && !self.looping && is_over {
            self.position_s = if self.reversed { self.duration_s } else { 0.0 };
            self.overrun_s = None;
            self.started_over = true;
        }
        self.playing = playing;
    }

    /// Pauses if playing, and plays if paused.
    pub fn toggle_playing(&mut self) {
        self.set_playing(!self.playing);
    }

    /// Goes to `position_s`, clamped to the clip, without playing or pausing.
    pub fn seek(&mut self, position_s: f64) {
        if position_s.is_finite() {
            self.position_s = position_s.clamp(0.0, self.duration_s);
            self.overrun_s = None;
        }
    }

    /// Pauses and goes to the next captured frame; in a loop, from the last to the first.
    pub fn step_forward(&mut self) {
        self.step_to((self.place() + SAME_FRAME).floor() + 1.0);
    }

    /// Pauses and goes to the previous captured frame; in a loop, from the first to the last.
    pub fn step_back(&mut self) {
        self.step_to((self.place() - SAME_FRAME).ceil() - 1.0);
    }

    fn step_to(&mut self, frame: f64) {
        self.playing = false;
        self.overrun_s = None;
        let last = self.last_frame() as f64;
        let frame = if (0.0..=last).contains(&frame) {
            frame
        } else if self.looping {
            if frame < 0.0 { last } else { 0.0 }
        } else {
            frame.clamp(0.0, last)
        };
        if self.fps > 0.0 {
            self.position_s = (frame / self.fps).min(self.duration_s);
        }
    }

    /// Sets the speed, clamped to [`SPEED_RANGE`].
    pub fn set_speed(&mut self, speed: f64) {
        if speed.is_finite() {
            self.speed = speed.clamp(SPEED_RANGE.0, SPEED_RANGE.1);
        }
    }

    /// Changes to the next faster of [`SPEEDS`].
    pub fn faster(&mut self) {
        self.set_speed(SPEEDS.into_iter().find(|&speed| speed > self.speed).unwrap_or(SPEED_RANGE.1));
    }

    /// Changes to the next slower of [`SPEEDS`].
    pub fn slower(&mut self) {
        self.set_speed(SPEEDS.into_iter().rev().find(|&speed| speed < self.speed).unwrap_or(SPEED_RANGE.0));
    }

    /// Sets whether the clip plays backwards.
    pub fn set_reversed(&mut self, reversed: bool) {
        self.reversed = reversed;
        self.overrun_s = self.overrun_s.filter(|_| !reversed);
    }

    /// Sets whether the clip starts over at its end.
    pub fn set_looping(&mut self, looping: bool) {
        self.looping = looping;
    }

    /// Normalised clip time, 0 to 1: the `t` of a field.
    pub fn clip_time(&self) -> f64 {
        if self.duration_s > 0.0 { self.position_s / self.duration_s } else { 0.0 }
    }

    /// Position in seconds from the start of the clip.
    pub fn position_s(&self) -> f64 {
        self.position_s
    }

    /// Duration of the clip in seconds; 0 for a single image.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Index of the captured frame at or before the position, up to [`Clock::last_frame`].
    pub fn frame(&self) -> u64 {
        (self.place() + SAME_FRAME) as u64
    }

    /// Index of the last captured frame. A frame at the end of a loop is the first again.
    pub fn last_frame(&self) -> u64 {
        let end = self.duration_s * self.fps;
        match self.starts_over() {
            true => ((end - SAME_FRAME).ceil() as u64).saturating_sub(1),
            false => (end + SAME_FRAME) as u64,
        }
    }

    /// The position in frames from the start; 0 at the end of a loop.
    fn place(&self) -> f64 {
        let [at, end] = [self.position_s, self.duration_s].map(|seconds| seconds * self.fps);
        if self.starts_over() && at > end - SAME_FRAME { 0.0 } else { at }
    }

    /// Whether the clip plays rather than pauses.
    pub fn is_playing(&self) -> bool {
        self.playing
    }

    /// Whether the position advances: the clip plays and is not a single image.
    pub fn is_advancing(&self) -> bool {
        self.playing && self.duration_s > 0.0
    }

    /// Seconds of real time until the clip comes to its end, or backwards to its start, at the present speed.
    pub fn remaining_s(&self) -> f64 {
        (if self.reversed { self.position_s } else { self.duration_s - self.position_s }) / self.speed
    }

    /// Whether the clip plays backwards.
    pub fn is_reversed(&self) -> bool {
        self.reversed
    }

    /// Whether the clip starts over at its end.
    pub fn is_looping(&self) -> bool {
        self.looping
    }

    /// Whether the start follows the end: the clip loops, and no other one follows.
    pub fn starts_over(&self) -> bool {
        self.looping && !self.has_next
    }

    /// Speed, 1 at the captured rate.
    pub fn speed(&self) -> f64 {
        self.speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2 s at 10 frames per second: frames 0 to 20.
    fn clock() -> Clock {
        Clock::new(2.0, 10.0)
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn plays_in_a_loop_from_the_start() {
        let mut clock = clock();
        assert!(clock.is_playing() && clock.is_looping());
        clock.advance(0.5);
        assert!(near(clock.position_s(), 0.5) && near(clock.clip_time(), 0.25));
        clock.advance(1.75);
        assert!(near(clock.position_s(), 0.25), "{clock:?}");
        clock.advance(20.0);
        assert!(near(clock.position_s(), 0.25), "several rounds in one step: {clock:?}");
    }

    #[test]
    fn plays_backwards_in_a_loop_from_the_end() {
        let mut clock = clock();
        clock.seek(0.5);
        clock.set_reversed(true);
        clock.set_speed(0.5);
        assert!(near(clock.remaining_s(), 1.0));
        clock.advance(0.5);
        assert!(near(clock.position_s(), 0.25) && !clock.take_started_over());
        clock.advance(1.0);
        assert!(near(clock.position_s(), 1.75) && clock.take_started_over(), "{clock:?}");
        clock.advance(40.0);
        assert!(near(clock.position_s(), 1.75), "several rounds in one step: {clock:?}");
        clock.set_reversed(false);
        clock.advance(0.2);
        assert!(near(clock.position_s(), 1.85), "{clock:?}");
        clock.set_reversed(true);
        clock.change_clip(3.0, 10.0);
        assert!(
            !clock.is_reversed() && clock.is_looping() && clock.speed() == 0.5,
            "another clip plays forward"
        );
    }

    #[test]
    fn backwards_without_a_loop_it_stops_at_the_start_and_plays_from_the_end_again() {
        for has_next in [false, true] {
            let mut clock = clock();
            clock.set_looping(false);
            clock.set_has_next(has_next);
            clock.seek(0.5);
            clock.set_reversed(true);
            clock.advance(0.6);
            assert_eq!((clock.position_s(), clock.is_playing(), clock.overrun_s()), (0.0, false, None));
            clock.toggle_playing();
            assert_eq!((clock.position_s(), clock.is_playing()), (2.0, true));
            clock.advance(0.5);
            assert!(near(clock.position_s(), 1.5), "{clock:?}");
        }
        // A clip that waits at its end for the next one turns round.
        let mut clock = clock();
        clock.set_has_next(true);
        clock.advance(2.5);
        assert!(clock.overrun_s().is_some());
        clock.set_reversed(true);
        clock.advance(0.5);
        assert_eq!((clock.position_s(), clock.overrun_s()), (1.5, None));
    }

    #[test]
    fn elapsed_time_of_zero_less_or_not_finite_changes_nothing() {
        let mut clock = clock();
        clock.advance(0.5);
        for elapsed_s in [0.0, -1e-9, -3600.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            clock.advance(elapsed_s);
            assert!(near(clock.position_s(), 0.5), "{elapsed_s}");
        }
        // The machine slept for a night.
        clock.advance(36_000.7);
        assert!((0.0..2.0).contains(&clock.position_s()), "{clock:?}");
    }

    #[test]
    fn waiting_holds_the_position_and_loses_no_time() {
        let mut clock = clock();
        clock.advance(0.5);
        clock.set_waiting(true);
        clock.advance(10.0);
        assert!(near(clock.position_s(), 0.5) && clock.is_waiting() && clock.is_advancing());
        clock.set_playing(false);
        assert!(!clock.is_waiting(), "paused");
        clock.set_playing(true);
        clock.set_waiting(false);
        clock.advance(0.1);
        assert!(near(clock.position_s(), 0.6) && !clock.is_waiting());
    }

    #[test]
    fn a_pause_holds_the_position() {
        let mut clock = clock();
        clock.advance(0.5);
        clock.toggle_playing();
        clock.advance(10.0);
        assert!(near(clock.position_s(), 0.5) && !clock.is_advancing());
        clock.toggle_playing();
        clock.advance(0.1);
        assert!(near(clock.position_s(), 0.6));
    }

    #[test]
    fn without_a_loop_it_stops_at_the_end_and_starts_over_on_play() {
        let mut clock = clock();
        clock.set_looping(false);
        clock.advance(5.0);
        assert!(near(clock.clip_time(), 1.0) && !clock.is_playing());
        clock.toggle_playing();
        assert!(clock.is_playing() && near(clock.position_s(), 0.0));
    }

    #[test]
    fn seeking_is_clamped_to_the_clip_and_keeps_playing() {
        let mut clock = clock();
        clock.seek(7.0);
        assert!(near(clock.position_s(), 2.0) && clock.is_playing());
        clock.seek(-1.0);
        assert!(near(clock.position_s(), 0.0));
        clock.seek(1.0);
        clock.seek(f64::NAN);
        assert!(near(clock.position_s(), 1.0));
    }

    #[test]
    fn after_a_seek_to_the_end_a_loop_starts_over() {
        let mut clock = clock();
        clock.seek(2.0);
        clock.advance(0.3);
        assert!(near(clock.position_s(), 0.3));
    }

    #[test]
    fn steps_lie_on_captured_frames() {
        let mut clock = clock();
        clock.seek(0.55);
        clock.step_forward();
        assert!(near(clock.position_s(), 0.6) && clock.frame() == 6 && !clock.is_playing());
        clock.step_forward();
        assert!(near(clock.position_s(), 0.7));
        clock.step_back();
        clock.step_back();
        assert!(near(clock.position_s(), 0.5));
        clock.seek(0.55);
        clock.step_back();
        assert!(near(clock.position_s(), 0.5));
    }

    #[test]
    fn steps_visit_every_frame_in_both_directions() {
        // 1/30 has no finite binary form: rounding must neither skip nor repeat a frame.
        let mut clock = Clock::new(10.0, 30.0);
        for (looping, last) in [(true, 299), (false, 300)] {
            clock.set_looping(looping);
            assert_eq!((clock.frame(), clock.last_frame()), (0, last));
            for frame in 1..=last {
                clock.step_forward();
                assert_eq!(clock.frame(), frame);
            }
            for frame in (0..last).rev() {
                clock.step_back();
                assert_eq!(clock.frame(), frame);
            }
        }
    }

    #[test]
    fn the_end_of_a_loop_is_its_first_frame_again() {
        let mut clock = clock();
        clock.seek(2.0);
        assert_eq!((clock.frame(), clock.last_frame()), (0, 19));
        clock.step_forward();
        assert_eq!(clock.frame(), 1);
        clock.seek(2.0);
        clock.step_back();
        assert_eq!(clock.frame(), 19);
        // With another clip behind it, the last frame is seen once.
        clock.set_has_next(true);
        clock.seek(2.0);
        assert_eq!((clock.frame(), clock.last_frame()), (20, 20));
        // Half a frame at the end.
        assert_eq!(Clock::new(2.05, 10.0).last_frame(), 20);
    }

    #[test]
    fn steps_wrap_only_in_a_loop() {
        let mut clock = clock();
        clock.step_back();
        assert_eq!(clock.frame(), 19);
        clock.step_forward();
        assert_eq!(clock.frame(), 0);
        clock.set_looping(false);
        clock.step_back();
        assert_eq!(clock.frame(), 0);
        clock.seek(2.0);
        clock.step_forward();
        assert_eq!(clock.frame(), 20);
    }

    #[test]
    fn speed_scales_time_and_stays_in_range() {
        let mut clock = clock();
        clock.set_speed(0.1);
        clock.advance(1.0);
        assert!(near(clock.position_s(), 0.1));
        clock.slower();
        assert!(near(clock.speed(), 0.1));
        clock.set_speed(0.6);
        clock.faster();
        assert!(near(clock.speed(), 0.75));
        clock.slower();
        assert!(near(clock.speed(), 0.5));
        clock.set_speed(100.0);
        clock.faster();
        assert!(near(clock.speed(), 2.0) && near(clock.remaining_s(), 0.95));
    }

    #[test]
    fn another_clip_starts_at_zero_with_the_same_settings() {
        let mut clock = clock();
        clock.set_speed(0.5);
        clock.set_looping(false);
        clock.seek(1.5);
        clock.toggle_playing();
        clock.change_clip(4.0, 25.0);
        assert!(near(clock.position_s(), 0.0) && near(clock.duration_s(), 4.0) && clock.last_frame() == 100);
        assert!(near(clock.speed(), 0.5) && !clock.is_looping() && clock.is_playing());
    }

    #[test]
    fn the_next_clip_continues_without_lost_time() {
        let mut clock = clock();
        clock.set_speed(0.5);
        clock.set_has_next(true);
        clock.seek(1.9);
        clock.advance(0.1);
        assert!(clock.overrun_s().is_none() && near(clock.position_s(), 1.95));
        clock.advance(0.2);
        assert!(near(clock.position_s(), 2.0) && clock.is_advancing(), "{clock:?}");
        assert!(near(clock.overrun_s().unwrap(), 0.05));
        clock.continue_with(4.0, 25.0);
        assert!(near(clock.position_s(), 0.05) && near(clock.duration_s(), 4.0), "{clock:?}");
        assert!(clock.overrun_s().is_none() && clock.speed() == 0.5 && clock.is_playing());
        clock.advance(20.0);
        assert!(near(clock.position_s(), 2.05), "no clip follows: {clock:?}");
    }

    #[test]
    fn a_clip_waits_at_its_end_for_the_next_one() {
        let mut clock = clock();
        clock.set_looping(false);
        clock.set_has_next(true);
        clock.advance(2.5);
        clock.advance(3.0);
        assert!(near(clock.position_s(), 2.0) && clock.is_playing() && clock.overrun_s() == Some(0.0));
        clock.seek(1.0);
        assert_eq!(clock.overrun_s(), None);
        clock.advance(1.5);
        clock.set_has_next(false);
        assert_eq!(clock.overrun_s(), None);
        clock.advance(0.1);
        assert!(near(clock.position_s(), 2.0) && !clock.is_playing(), "no clip follows any more");
    }

    #[test]
    fn playing_from_the_end_starts_over_even_if_a_clip_follows() {
        let mut clock = clock();
        clock.set_looping(false);
        clock.set_has_next(true);
        clock.advance(2.5);
        clock.set_playing(false);
        assert!(clock.overrun_s().is_some() && !clock.take_started_over());
        clock.set_playing(true);
        assert!(near(clock.position_s(), 0.0) && clock.overrun_s().is_none(), "{clock:?}");
        assert!(clock.take_started_over() && !clock.take_started_over());
    }

    #[test]
    fn starting_over_is_reported_once() {
        let mut clock = clock();
        clock.advance(1.9);
        assert!(!clock.take_started_over());
        clock.advance(0.2);
        assert!(clock.take_started_over() && !clock.take_started_over());
    }

    #[test]
    fn a_single_image_has_one_position() {
        for (duration_s, fps) in [(0.0, 30.0), (f64::NAN, 30.0), (-1.0, f64::INFINITY)] {
            let mut clock = Clock::new(duration_s, fps);
            clock.advance(1.0);
            clock.step_forward();
            clock.step_back();
            clock.seek(3.0);
            assert!(clock.clip_time() == 0.0 && !clock.is_advancing(), "{clock:?}");
        }
    }
}
