//! [`Quality`]: the best level of quality that the headset keeps up with.
//!
//! The levels go from the best down; the viewer chooses the best level to use. A frame is late if the display repeated
//! the frame before, or the GPU took longer than the display's period. Late frames fill a bucket and punctual ones
//! empty it; when it is full, the level drops by one. When the GPU has had room for a while, it rises by one. Where the
//! GPU has no timestamps, a longer time without a late frame counts as room. A rise that does not last doubles the time
//! until the next one, so that the picture does not flicker between levels.
//!
//! A headset that warns of its heat steps down, too, and not up again until it is cooler.
//!
//! Before the last level, which shows Gaussians without their edges, the display slows down, if it can. `Least` is the
//! floor: below it the player drops frames instead of quality.

use glam::UVec2;

use crate::gpu::{Level, RenderSettings};

/// Load of the GPU, relative to the display's period, below which there is room for the next higher level, which takes
/// up to 2.3 times as long. Above `Least`, which may drop layers, it may take longer: there a rise may not last.
const ROOM: f64 = 0.42;

/// What a late frame adds to the bucket, a punctual one takes from it, and how much it holds: six late frames in a row
/// fill it, and so does one in fourteen within ten seconds.
const LATE: u32 = 16;
const PUNCTUAL: u32 = 1;
const BUCKET: u32 = 6 * LATE;

/// Frames with room before a rise: initially and at most; and how many times as many without timestamps.
const ROOM_FRAMES: (u32, u32) = (180, 180 << 4);
const UNTIMED: u32 = 4;

/// How the latest frame kept the display's time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Punctuality {
    /// Milliseconds of the GPU; `None` if it has no timestamps.
    pub(crate) gpu_ms: Option<f64>,
    /// Milliseconds between two images of the display; 0 if the runtime does not know.
    pub(crate) period_ms: f64,
    /// Whether the display repeated the frame before because this one was not ready.
    pub(crate) missed: bool,
}

/// How hot the headset is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Heat {
    #[default]
    Normal,
    /// It will slow down unless the program does less.
    Warning,
    /// It has slowed down.
    Impaired,
}

/// The rates that the display can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pace {
    /// The best rate of the display.
    Full,
    /// A slower one, which leaves a frame more time.
    Slow,
}

/// The level in use, and how it follows the headset.
#[derive(Clone, Debug)]
pub(crate) struct Quality {
    /// Settings of the command line: no level draws more.
    asked: RenderSettings,
    /// Number of Gaussians in the first k layers, for each k.
    layer_ends: Vec<usize>,
    /// The best level to use.
    chosen: Level,
    level: Level,
    adapts: bool,
    pace: Pace,
    /// Whether the display has a slower rate.
    can_slow: bool,
    /// Whether frames can have an inset.
    can_foveate: bool,
    /// How full the bucket is.
    late: u32,
    room: u32,
    room_frames: u32,
    heat: Heat,
    /// Whether the latest step went up.
    climbed: bool,
}

impl Quality {
    /// Starts at the level `chosen` and draws no more than `asked`. Without `adapts` the level changes only
    /// at the viewer's wish.
    pub(crate) fn new(asked: RenderSettings, chosen: Level, adapts: bool) -> Quality {
        Quality {
            asked,
            layer_ends: Vec::new(),
            chosen,
            level: chosen,
            adapts,
            pace: Pace::Full,
            can_slow: false,
            can_foveate: true,
            late: 0,
            room: 0,
            room_frames: ROOM_FRAMES.0,
            heat: Heat::Normal,
            climbed: false,
        }
    }

    /// Starts on another display, at its best rate, which has a slower one or not, and with memory for an inset or not; how
    /// hot it is, it says anew.
    pub(crate) fn change_display(&mut self, can_slow: bool, can_foveate: bool) {
        (self.pace, self.can_slow, self.can_foveate) = (Pace::Full, can_slow, can_foveate);
        self.heat = Heat::Normal;
    }

    /// The rate that the display should have.
    pub(crate) fn pace(&self) -> Pace {
        self.pace
    }

    /// Changes to a clip with `layer_ends[k - 1]` Gaussians in its first k layers.
    pub(crate) fn change_clip(&mut self, layer_ends: Vec<usize>) {
        self.layer_ends = layer_ends;
    }

    /// Number of layers of the clip.
    pub(crate) fn layers(&self) -> usize {
        self.layer_ends.len()
    }

    /// Settings of the next frame.
    pub(crate) fn settings(&self) -> RenderSettings {
        let settings = self.level.settings(self.asked, &self.layer_ends);
        RenderSettings { inset: settings.inset.filter(|_| self.can_foveate), ..settings }
    }

    /// Size of the next frame's viewport in an image of `full` pixels.
    pub(crate) fn size(&self, full: UVec2) -> UVec2 {
        self.level.size(full)
    }

    /// The level in use.
    pub(crate) fn level(&self) -> Level {
        self.level
    }

    /// Whether the level is below the chosen one or the display slower, because the headset does not keep up.
    pub(crate) fn is_lowered(&self) -> bool {
        self.level > self.chosen || self.pace == Pace::Slow
    }

    /// Changes to the next better level, for a viewer who wants more than is seen now. What was chosen before stays within
    /// reach.
    pub(crate) fn improve(&mut self) {
        let level = self.level.better();
        self.choose(level, level.min(self.chosen));
    }

    /// Changes to the next coarser level, the best one from now on.
    pub(crate) fn coarsen(&mut self) {
        let level = self.level.coarser();
        self.choose(level, level);
    }

    /// Changes to `level`, and to `chosen` as the best one.
    fn choose(&mut self, level: Level, chosen: Level) {
        (self.chosen, self.level, self.pace) = (chosen, level, Pace::Full);
        (self.late, self.room) = (0, 0);
        (self.room_frames, self.climbed) = (ROOM_FRAMES.0, false);
    }

    /// Takes in how a frame kept the display's time.
    pub(crate) fn measure(&mut self, frame: Punctuality) {
        if !self.adapts || frame.period_ms <= 0.0 {
            return;
        }
        let load = frame.gpu_ms.map(|ms| ms / frame.period_ms);
        let is_late = frame.missed || load.is_some_and(|load| load > 1.0);
        self.late = if is_late { self.late + LATE } else { self.late.saturating_sub(PUNCTUAL) };
        let has_room = !is_late && load.is_none_or(|load| load < ROOM);
        self.room = if has_room { self.room + 1 } else { 0 };
        let room_frames = if load.is_some() { self.room_frames } else { UNTIMED * self.room_frames };
        if self.late >= BUCKET {
            self.late = 0;
            self.lower();
        } else if self.room >= room_frames && self.is_lowered() && self.heat == Heat::Normal {
            self.raise();
        }
    }

    /// Takes in how hot the headset is: a step down for each degree that it rises.
    pub(crate) fn change_heat(&mut self, heat: Heat) {
        let steps = (heat as usize).saturating_sub(self.heat as usize);
        self.heat = heat;
        if self.adapts {
            (0..steps).for_each(|_| self.lower());
        }
    }

    /// Steps down, if there is a step.
    fn lower(&mut self) {
        let next = self.level.coarser();
        let (level, pace) = match (next, self.pace) {
            (Level::Least, Pace::Full) if self.can_slow => (self.level, Pace::Slow),
            (_, pace) => (next, pace),
        };
        if (level, pace) != (self.level, self.pace) {
            if self.climbed {
                self.room_frames = (2 * self.room_frames).min(ROOM_FRAMES.1);
            }
            self.step(level, pace, false);
        }
    }

    /// Takes the last step down back.
    fn raise(&mut self) {
        let (level, pace) = match (self.level, self.pace) {
            (Level::Least, pace) if self.chosen < Level::Least => (Level::Light, pace),
            (level, Pace::Slow) => (level, Pace::Full),
            (level, pace) => (level.better(), pace),
        };
        self.step(level, pace, true);
    }

    fn step(&mut self, level: Level, pace: Pace, climbed: bool) {
        log::info!("quality {}, display at {pace:?} rate", level.name());
        (self.level, self.pace, self.climbed, self.late, self.room) = (level, pace, climbed, 0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::Cutoff;

    const PERIOD_MS: f64 = 1000.0 / 90.0;
    const LAYERS: [usize; 2] = [20_000, 40_000];

    fn quality(chosen: Level) -> Quality {
        let mut quality = Quality::new(RenderSettings::default(), chosen, true);
        quality.change_clip(LAYERS.to_vec());
        quality
    }

    /// A headset, and when it shows what the player draws.
    struct Headset {
        /// Milliseconds of the GPU at each level.
        ms: [f64; 6],
        timed: bool,
    }

    impl Headset {
        fn period_ms(pace: Pace) -> f64 {
            match pace {
                Pace::Full => PERIOD_MS,
                Pace::Slow => 1000.0 / 72.0,
            }
        }

        /// How a frame keeps the time if it takes `part` of the GPU's time at its level.
        fn frame(&self, quality: &Quality, part: f64) -> Punctuality {
            let (ms, period_ms) = (part * self.ms[quality.level() as usize], Self::period_ms(quality.pace()));
            Punctuality { gpu_ms: self.timed.then_some(ms), period_ms, missed: ms > period_ms }
        }

        /// Shows frames that take the `part(i)` of the GPU's time; returns the number of steps.
        fn show(&self, quality: &mut Quality, frames: usize, part: impl Fn(usize) -> f64) -> usize {
            (0..frames).fold(0, |steps, i| {
                let before = (quality.level(), quality.pace());
                quality.measure(self.frame(quality, part(i)));
                steps + usize::from((quality.level(), quality.pace()) != before)
            })
        }
    }

    /// With timestamps and without.
    fn headsets(ms: [f64; 6]) -> [Headset; 2] {
        [true, false].map(|timed| Headset { ms, timed })
    }

    /// A load that stays.
    fn constant(_: usize) -> f64 {
        1.0
    }

    #[test]
    fn a_fast_gpu_keeps_the_best() {
        for headset in headsets([10.0, 6.0, 4.0, 3.0, 2.0, 1.0]) {
            let mut quality = quality(Level::Exact);
            assert_eq!(headset.show(&mut quality, 5000, constant), 0);
            assert_eq!(quality.settings(), RenderSettings::default());
            assert_eq!(quality.size(UVec2::new(2064, 2208)), UVec2::new(2064, 2208));
        }
    }

    #[test]
    fn a_slow_gpu_drops_to_the_floor_and_no_further() {
        for headset in headsets([60.0, 50.0, 40.0, 30.0, 25.0, 20.0]) {
            let mut quality = quality(Level::Exact);
            assert_eq!(headset.show(&mut quality, 5000, constant), 5);
            assert!(quality.level() == Level::Least && quality.is_lowered());
            let RenderSettings { cutoff, layers, .. } = quality.settings();
            assert_eq!((cutoff, layers), (Cutoff::Sqrt5, Some(1)));
        }
    }

    #[test]
    fn the_display_slows_down_before_gaussians_lose_their_edges() {
        for headset in headsets([60.0, 50.0, 40.0, 30.0, 13.0, 11.0]) {
            let mut quality = quality(Level::Exact);
            quality.change_display(true, true);
            headset.show(&mut quality, 5000, constant);
            assert_eq!((quality.level(), quality.pace()), (Level::Light, Pace::Slow), "13 ms fit into 72 Hz");
        }
        let [slower, _] = headsets([60.0, 50.0, 40.0, 30.0, 15.0, 11.0]);
        let mut quality = quality(Level::Exact);
        quality.change_display(true, true);
        slower.show(&mut quality, 300, constant);
        assert_eq!((quality.level(), quality.pace()), (Level::Least, Pace::Slow));
        let [faster, _] = headsets([1.0; 6]);
        faster.show(&mut quality, 400, constant);
        assert_eq!(
            (quality.level(), quality.pace()),
            (Level::Light, Pace::Full),
            "back in the opposite order"
        );
    }

    #[test]
    fn a_hot_headset_steps_down_until_it_is_cooler() {
        let [fast, _] = headsets([1.0; 6]);
        let mut hot = quality(Level::Exact);
        hot.change_heat(Heat::Warning);
        hot.change_heat(Heat::Warning);
        assert!(hot.level() == Level::Fine && hot.is_lowered());
        hot.change_heat(Heat::Impaired);
        assert_eq!(
            (hot.level(), fast.show(&mut hot, 1000, constant)),
            (Level::Good, 0),
            "although there is room"
        );
        hot.change_heat(Heat::Normal);
        assert_eq!((fast.show(&mut hot, 1000, constant), hot.level()), (2, Level::Exact));
        hot.change_heat(Heat::Impaired);
        assert_eq!(hot.level(), Level::Good, "at once");
        hot.change_display(false, true);
        assert_eq!(fast.show(&mut hot, 1000, constant), 2, "another session says how hot it is");
        let mut measured = Quality::new(RenderSettings::default(), Level::Exact, false);
        measured.change_heat(Heat::Impaired);
        assert_eq!(measured.level(), Level::Exact);
    }

    #[test]
    fn single_late_frames_change_nothing() {
        for headset in headsets([8.0; 6]) {
            let mut quality = quality(Level::Exact);
            // One in twenty, and a burst of five at the start of every ten seconds.
            let spikes = |i: usize| if i.is_multiple_of(20) || i % 900 < 5 { 5.0 } else { 1.0 };
            assert_eq!(headset.show(&mut quality, 20_000, spikes), 0);
        }
    }

    #[test]
    fn a_rate_that_is_not_held_drops_the_level() {
        for headset in headsets([8.0, 5.0, 4.0, 3.0, 2.0, 1.0]) {
            let mut quality = quality(Level::Exact);
            // One late frame in ten, which never fills a row.
            let noise = |i: usize| if i.is_multiple_of(10) { 1.5 } else { 1.0 };
            headset.show(&mut quality, 300, noise);
            assert_eq!(quality.level(), Level::Fine);
        }
    }

    #[test]
    fn a_ramp_goes_down_the_levels_and_up_again_one_by_one() {
        for headset in headsets([1.0, 0.6, 0.4, 0.25, 0.18, 0.1].map(|part| 10.0 * part)) {
            let mut quality = quality(Level::Exact);
            // From 5 ms to 45 ms of the best level within a minute, and back.
            let frames = 90 * 60;
            let up = |i: usize| 0.5 + 4.0 * i as f64 / frames as f64;
            let down = headset.show(&mut quality, frames, up);
            // Without timestamps it tries the better level now and then.
            assert_eq!(quality.level(), Level::Light);
            assert!(down == 4 || !headset.timed && down <= 10, "{down} steps");
            let back = headset.show(&mut quality, frames, |i| up(frames - i));
            headset.show(&mut quality, 4 * 90 * 60, |_| 0.3);
            assert_eq!(quality.level(), Level::Exact);
            assert!(back <= 10, "{back} steps");
        }
    }

    #[test]
    fn room_raises_the_level_after_a_while() {
        let mut quality = quality(Level::Exact);
        let [near, _] = headsets([20.0, 8.0, 6.0, 6.0, 6.0, 6.0]);
        near.show(&mut quality, 10, constant);
        assert_eq!(quality.level(), Level::Fine, "the face was near");
        let [far, untimed] = headsets([4.0; 6]);
        far.show(&mut quality, 100, constant);
        assert_eq!(quality.level(), Level::Fine);
        far.show(&mut quality, 200, constant);
        assert_eq!(quality.level(), Level::Exact);
        near.show(&mut quality, 10, constant);
        untimed.show(&mut quality, 1400, constant);
        assert_eq!(quality.level(), Level::Fine, "without timestamps, and after a rise that did not last");
        untimed.show(&mut quality, 100, constant);
        assert_eq!(quality.level(), Level::Exact);
    }

    #[test]
    fn between_two_levels_it_settles() {
        // The better one is too slow and the lower one leaves room: the case that makes pictures flicker.
        for above in 0..5 {
            for headset in headsets([0, 1, 2, 3, 4, 5].map(|level| if level <= above { 12.0 } else { 4.0 })) {
                let mut quality = quality(Level::Exact);
                quality.change_display(above % 2 == 0, true);
                headset.show(&mut quality, 20_000, constant);
                let late = headset.show(&mut quality, 10_000, constant);
                assert!(late <= 8, "{late} steps in 111 s");
            }
        }
    }

    #[test]
    fn levels_with_the_costs_of_a_room_never_alternate() {
        // Relative cost of a room from inside at each level, on GPUs of every speed.
        for fastest in [2.0, 5.0, 9.0, 10.0, 15.0, 30.0, 80.0] {
            let [headset, _] = headsets([1.0, 0.44, 0.29, 0.21, 0.16, 0.08].map(|part| part * fastest));
            let mut quality = quality(Level::Exact);
            assert!(headset.show(&mut quality, 100_000, constant) <= 5, "{fastest} ms");
        }
    }

    #[test]
    fn the_viewer_sets_the_best_to_use() {
        let [headset, _] = headsets([1.0; 6]);
        let mut quality = quality(Level::Good);
        headset.show(&mut quality, 5000, constant);
        assert!(quality.level() == Level::Good && !quality.is_lowered(), "never better than chosen");
        quality.choose(Level::Exact, Level::Exact);
        assert_eq!(quality.settings().cutoff, Cutoff::Exact);
        let mut fixed = Quality::new(RenderSettings::default(), Level::Fair, false);
        let [slow, _] = headsets([99.0; 6]);
        assert_eq!(slow.show(&mut fixed, 5000, constant), 0);
        quality.measure(Punctuality::default());
        assert_eq!(quality.level(), Level::Exact, "without a period nothing changes");
    }

    #[test]
    fn better_than_a_lowered_level_is_no_new_ceiling() {
        let [slow, _] = headsets([99.0, 99.0, 99.0, 99.0, 9.0, 1.0]);
        let [fast, _] = headsets([1.0; 6]);
        let mut quality = quality(Level::Fine);
        slow.show(&mut quality, 300, constant);
        assert_eq!(quality.level(), Level::Light);
        quality.improve();
        assert!(quality.level() == Level::Fair && quality.is_lowered());
        fast.show(&mut quality, 5000, constant);
        assert_eq!(quality.level(), Level::Fine);
        quality.improve();
        assert!(quality.level() == Level::Exact && !quality.is_lowered(), "the viewer may raise it");
        quality.coarsen();
        fast.show(&mut quality, 5000, constant);
        assert_eq!(quality.level(), Level::Fine, "and lower it");
    }

    #[test]
    fn without_memory_for_an_inset_there_is_none() {
        let mut quality = quality(Level::Good);
        assert_eq!(quality.settings().inset, Some(0.4));
        quality.change_display(false, false);
        assert_eq!((quality.settings().inset, quality.settings().cutoff), (None, Cutoff::Sqrt8));
    }

    #[test]
    fn the_least_level_draws_fewer_layers_than_asked_for() {
        let mut quality =
            Quality::new(RenderSettings { layers: Some(3), ..RenderSettings::default() }, Level::Least, true);
        quality.change_clip(vec![10, 20, 30]);
        assert_eq!(quality.settings().layers, Some(2));
    }
}
