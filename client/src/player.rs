//! [`Player`]: the clock of a playing clip, without windows, headsets or a GPU.
//!
//! The driver says how much time went by (wall time in a window, predicted display time in a
//! headset) and asks for the clip time to draw. All positions are seconds from the start of the
//! clip; the normalised clip time of a field is [`Player::clip_time`].

/// Slowest and fastest rate of playing.
pub const SPEED_RANGE: (f64, f64) = (0.1, 2.0);

/// Rates that [`Player::faster`] and [`Player::slower`] step through.
pub const SPEEDS: [f64; 8] = [0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0];

/// Frame positions that are this close, in frames, count as the same.
const SAME_FRAME: f64 = 1e-3;

/// Where a clip stands and how it moves on.
#[derive(Clone, Debug, PartialEq)]
pub struct Player {
    duration_s: f64,
    fps: f64,
    position_s: f64,
    playing: bool,
    looping: bool,
    speed: f64,
    /// Whether another clip follows.
    followed: bool,
    /// How far beyond the end it would be, in seconds of the clip, where another one follows.
    over_s: Option<f64>,
    /// Whether it went from its end to its start since that was asked last.
    started_over: bool,
}

impl Player {
    /// A clip of `duration_s` seconds captured at `fps` frames per second, playing in a loop from
    /// its start. A duration or rate that is not a positive number makes the clip a still picture.
    pub fn new(duration_s: f64, fps: f64) -> Player {
        let positive = |x: f64| if x.is_finite() && x > 0.0 { x } else { 0.0 };
        Player {
            duration_s: positive(duration_s),
            fps: positive(fps),
            position_s: 0.0,
            playing: true,
            looping: true,
            speed: 1.0,
            followed: false,
            over_s: None,
            started_over: false,
        }
    }

    /// Changes to another clip and plays it from its start; loop and speed are kept.
    pub fn change_clip(&mut self, duration_s: f64, fps: f64) {
        let Player { looping, speed, .. } = *self;
        *self = Player { looping, speed, ..Player::new(duration_s, fps) };
    }

    /// Goes on with the clip that follows, as far beyond its start as this one is beyond its end.
    pub fn follow_with(&mut self, duration_s: f64, fps: f64) {
        let (over_s, playing) = (self.over_s.unwrap_or(0.0), self.playing);
        self.change_clip(duration_s, fps);
        self.position_s = over_s.min(self.duration_s);
        self.playing = playing;
    }

    /// Sets whether another clip follows at the end, for which this one then waits on its last instant.
    pub fn set_followed(&mut self, followed: bool) {
        self.followed = followed;
        self.over_s = self.over_s.filter(|_| followed);
    }

    /// At the end of a clip that another one follows: by how many seconds of the clip the last step went
    /// beyond it.
    pub fn over_s(&self) -> Option<f64> {
        self.over_s
    }

    /// Whether the clip started over at its end since this was asked last.
    pub fn take_started_over(&mut self) -> bool {
        std::mem::take(&mut self.started_over)
    }

    /// Moves on by `elapsed_s` seconds of the viewer's time. At the end a clip waits for the one that
    /// follows, where one does; else a looping one starts over, any other stops on its last instant.
    pub fn advance(&mut self, elapsed_s: f64) {
        if !self.is_moving() || !elapsed_s.is_finite() || elapsed_s <= 0.0 {
            return;
        }
        let position = self.position_s + elapsed_s * self.speed;
        if position < self.duration_s {
            self.position_s = position;
        } else if self.followed {
            // It waits from the second step on.
            self.over_s = Some(self.over_s.map_or(position - self.duration_s, |_| 0.0));
            self.position_s = self.duration_s;
        } else if self.looping {
            self.position_s = position % self.duration_s;
            self.started_over = true;
        } else {
            self.position_s = self.duration_s;
            self.playing = false;
        }
    }

    /// Plays or pauses. Playing from the end starts over.
    pub fn set_playing(&mut self, playing: bool) {
        if playing && !self.looping && self.position_s >= self.duration_s {
            self.position_s = 0.0;
            self.over_s = None;
            self.started_over = true;
        }
        self.playing = playing;
    }

    /// Turns playing into pause and back.
    pub fn toggle_playing(&mut self) {
        self.set_playing(!self.playing);
    }

    /// Goes to `position_s` seconds, cut to the clip; keeps playing or pausing.
    pub fn seek(&mut self, position_s: f64) {
        if position_s.is_finite() {
            self.position_s = position_s.clamp(0.0, self.duration_s);
            self.over_s = None;
        }
    }

    /// Pauses and goes to the next captured frame, from the last one to the first where the clip
    /// loops.
    pub fn step_forward(&mut self) {
        let at = self.position_s * self.fps;
        self.step_to((at + SAME_FRAME).floor() + 1.0);
    }

    /// Pauses and goes to the captured frame before, from the first one to the last where the
    /// clip loops.
    pub fn step_back(&mut self) {
        let at = self.position_s * self.fps;
        self.step_to((at - SAME_FRAME).ceil() - 1.0);
    }

    fn step_to(&mut self, frame: f64) {
        self.playing = false;
        self.over_s = None;
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

    /// Sets the rate of playing, cut to [`SPEED_RANGE`].
    pub fn set_speed(&mut self, speed: f64) {
        if speed.is_finite() {
            self.speed = speed.clamp(SPEED_RANGE.0, SPEED_RANGE.1);
        }
    }

    /// The next faster rate of [`SPEEDS`].
    pub fn faster(&mut self) {
        self.set_speed(SPEEDS.into_iter().find(|&speed| speed > self.speed).unwrap_or(SPEED_RANGE.1));
    }

    /// The next slower rate of [`SPEEDS`].
    pub fn slower(&mut self) {
        self.set_speed(SPEEDS.into_iter().rev().find(|&speed| speed < self.speed).unwrap_or(SPEED_RANGE.0));
    }

    /// Whether the clip starts over at its end.
    pub fn set_looping(&mut self, looping: bool) {
        self.looping = looping;
    }

    /// Normalised clip time, 0 to 1: the `t` of a field.
    pub fn clip_time(&self) -> f64 {
        if self.duration_s > 0.0 { self.position_s / self.duration_s } else { 0.0 }
    }

    /// Seconds from the start of the clip.
    pub fn position_s(&self) -> f64 {
        self.position_s
    }

    /// Length of the clip in seconds; 0 for a still picture.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Number of the captured frame at or just before the position, from 0.
    pub fn frame(&self) -> u64 {
        (self.position_s * self.fps + SAME_FRAME) as u64
    }

    /// Number of the last captured frame, from 0.
    pub fn last_frame(&self) -> u64 {
        (self.duration_s * self.fps + SAME_FRAME) as u64
    }

    /// Whether the clip is playing rather than paused.
    pub fn is_playing(&self) -> bool {
        self.playing
    }

    /// Whether the picture changes by itself: playing, and not a still picture.
    pub fn is_moving(&self) -> bool {
        self.playing && self.duration_s > 0.0
    }

    /// Whether the clip starts over at its end.
    pub fn is_looping(&self) -> bool {
        self.looping
    }

    /// Rate of playing, 1 being life.
    pub fn speed(&self) -> f64 {
        self.speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2 s at 10 frames per second: frames 0 to 20.
    fn player() -> Player {
        Player::new(2.0, 10.0)
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn plays_in_a_loop_from_the_start() {
        let mut player = player();
        assert!(player.is_playing() && player.is_looping());
        player.advance(0.5);
        assert!(near(player.position_s(), 0.5) && near(player.clip_time(), 0.25));
        player.advance(1.75);
        assert!(near(player.position_s(), 0.25), "{player:?}");
        player.advance(20.0);
        assert!(near(player.position_s(), 0.25), "several rounds in one step: {player:?}");
    }

    #[test]
    fn time_that_stands_still_or_goes_back_moves_nothing() {
        let mut player = player();
        player.advance(0.5);
        for elapsed_s in [0.0, -1e-9, -3600.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            player.advance(elapsed_s);
            assert!(near(player.position_s(), 0.5), "{elapsed_s}");
        }
        // After a night's sleep it is somewhere in the clip.
        player.advance(36_000.7);
        assert!((0.0..2.0).contains(&player.position_s()), "{player:?}");
    }

    #[test]
    fn a_pause_holds_the_position() {
        let mut player = player();
        player.advance(0.5);
        player.toggle_playing();
        player.advance(10.0);
        assert!(near(player.position_s(), 0.5) && !player.is_moving());
        player.toggle_playing();
        player.advance(0.1);
        assert!(near(player.position_s(), 0.6));
    }

    #[test]
    fn without_a_loop_it_stops_at_the_end_and_starts_over_on_play() {
        let mut player = player();
        player.set_looping(false);
        player.advance(5.0);
        assert!(near(player.clip_time(), 1.0) && !player.is_playing());
        player.toggle_playing();
        assert!(player.is_playing() && near(player.position_s(), 0.0));
    }

    #[test]
    fn seeking_is_cut_to_the_clip_and_keeps_playing() {
        let mut player = player();
        player.seek(7.0);
        assert!(near(player.position_s(), 2.0) && player.is_playing());
        player.seek(-1.0);
        assert!(near(player.position_s(), 0.0));
        player.seek(1.0);
        player.seek(f64::NAN);
        assert!(near(player.position_s(), 1.0));
    }

    #[test]
    fn a_scrub_to_the_end_plays_on_in_a_loop() {
        let mut player = player();
        player.seek(2.0);
        player.advance(0.3);
        assert!(near(player.position_s(), 0.3));
    }

    #[test]
    fn steps_lie_on_captured_frames() {
        let mut player = player();
        player.seek(0.55);
        player.step_forward();
        assert!(near(player.position_s(), 0.6) && player.frame() == 6 && !player.is_playing());
        player.step_forward();
        assert!(near(player.position_s(), 0.7));
        player.step_back();
        player.step_back();
        assert!(near(player.position_s(), 0.5));
        player.seek(0.55);
        player.step_back();
        assert!(near(player.position_s(), 0.5));
    }

    #[test]
    fn every_frame_is_reached_both_ways() {
        // 1/30 has no finite binary form: rounding must neither skip nor repeat a frame.
        let mut player = Player::new(10.0, 30.0);
        for frame in 1..=300 {
            player.step_forward();
            assert_eq!(player.frame(), frame);
        }
        for frame in (0..300).rev() {
            player.step_back();
            assert_eq!(player.frame(), frame);
        }
    }

    #[test]
    fn steps_wrap_only_in_a_loop() {
        let mut player = player();
        player.step_back();
        assert_eq!(player.frame(), 20);
        player.step_forward();
        assert_eq!(player.frame(), 0);
        player.set_looping(false);
        player.step_back();
        assert_eq!(player.frame(), 0);
        player.seek(2.0);
        player.step_forward();
        assert_eq!(player.frame(), 20);
    }

    #[test]
    fn speed_scales_time_and_stays_in_range() {
        let mut player = player();
        player.set_speed(0.1);
        player.advance(1.0);
        assert!(near(player.position_s(), 0.1));
        player.slower();
        assert!(near(player.speed(), 0.1));
        player.set_speed(0.6);
        player.faster();
        assert!(near(player.speed(), 0.75));
        player.slower();
        assert!(near(player.speed(), 0.5));
        player.set_speed(100.0);
        player.faster();
        assert!(near(player.speed(), 2.0));
    }

    #[test]
    fn another_clip_starts_at_zero_with_the_same_settings() {
        let mut player = player();
        player.set_speed(0.5);
        player.set_looping(false);
        player.seek(1.5);
        player.toggle_playing();
        player.change_clip(4.0, 25.0);
        assert!(
            near(player.position_s(), 0.0) && near(player.duration_s(), 4.0) && player.last_frame() == 100
        );
        assert!(near(player.speed(), 0.5) && !player.is_looping() && player.is_playing());
    }

    #[test]
    fn a_clip_that_follows_loses_no_time() {
        let mut player = player();
        player.set_speed(0.5);
        player.set_followed(true);
        player.seek(1.9);
        player.advance(0.1);
        assert!(player.over_s().is_none() && near(player.position_s(), 1.95));
        player.advance(0.2);
        assert!(near(player.position_s(), 2.0) && player.is_moving(), "{player:?}");
        assert!(near(player.over_s().unwrap(), 0.05));
        player.follow_with(4.0, 25.0);
        assert!(near(player.position_s(), 0.05) && near(player.duration_s(), 4.0), "{player:?}");
        assert!(player.over_s().is_none() && player.speed() == 0.5 && player.is_playing());
        player.advance(20.0);
        assert!(near(player.position_s(), 2.05), "nothing follows that: {player:?}");
    }

    #[test]
    fn a_clip_waits_on_its_last_instant_for_the_one_that_follows() {
        let mut player = player();
        player.set_looping(false);
        player.set_followed(true);
        player.advance(2.5);
        player.advance(3.0);
        assert!(near(player.position_s(), 2.0) && player.is_playing() && player.over_s() == Some(0.0));
        player.seek(1.0);
        assert_eq!(player.over_s(), None);
        player.advance(1.5);
        player.set_followed(false);
        assert_eq!(player.over_s(), None);
        player.advance(0.1);
        assert!(near(player.position_s(), 2.0) && !player.is_playing(), "there is none after all");
    }

    #[test]
    fn playing_from_the_end_starts_over_though_another_clip_follows() {
        let mut player = player();
        player.set_looping(false);
        player.set_followed(true);
        player.advance(2.5);
        player.set_playing(false);
        assert!(player.over_s().is_some() && !player.take_started_over());
        player.set_playing(true);
        assert!(near(player.position_s(), 0.0) && player.over_s().is_none(), "{player:?}");
        assert!(player.take_started_over() && !player.take_started_over());
    }

    #[test]
    fn a_loop_tells_that_it_started_over() {
        let mut player = player();
        player.advance(1.9);
        assert!(!player.take_started_over());
        player.advance(0.2);
        assert!(player.take_started_over() && !player.take_started_over());
    }

    #[test]
    fn a_still_picture_has_one_instant() {
        for (duration_s, fps) in [(0.0, 30.0), (f64::NAN, 30.0), (-1.0, f64::INFINITY)] {
            let mut player = Player::new(duration_s, fps);
            player.advance(1.0);
            player.step_forward();
            player.step_back();
            player.seek(3.0);
            assert!(player.clip_time() == 0.0 && !player.is_moving(), "{player:?}");
        }
    }
}
