//! [`Quality`]: draws as well as the GPU keeps up with.
//!
//! The levels go from the best down; the viewer chooses the best one to use. When the GPU takes
//! longer than its share of a frame for a few frames in a row, the next lower level is taken; when
//! it has had much room for a while, the next higher. A step up that does not last doubles the time
//! until the next one is tried, so that the picture does not waver. The lowest level is a bound on
//! what may be left out: the viewer rather sees frames missing than limbs.

use glam::UVec2;

use crate::gpu::{Level, RenderSettings};

/// Part of a frame's time that the GPU may take: the runtime needs the rest.
const SHARE: f64 = 0.8;

/// Part of that below which there is room for the next higher level, which takes up to 1.6 times as
/// long.
const ROOM: f64 = 0.55;

/// Frames in a row that must be too slow, and frames of room that must have passed at first and at
/// most.
const SLOW_FRAMES: u32 = 6;
const ROOM_FRAMES: (u32, u32) = (180, 180 << 4);

/// What is drawn, and how that follows the GPU.
#[derive(Clone, Debug)]
pub(super) struct Quality {
    /// What was asked for: no level draws more.
    asked: RenderSettings,
    /// Gaussians in the first layer of the clip, the first two, and so on.
    layer_ends: Vec<usize>,
    /// The best level to use.
    chosen: Level,
    level: Level,
    adapts: bool,
    slow: u32,
    room: u32,
    room_frames: u32,
    /// Whether the latest step went up.
    climbed: bool,
}

impl Quality {
    /// Begins at the level `chosen`, with no more drawn than `asked`. Without `adapts` it follows
    /// the viewer only.
    pub(super) fn new(asked: RenderSettings, chosen: Level, adapts: bool) -> Quality {
        Quality {
            asked,
            layer_ends: Vec::new(),
            chosen,
            level: chosen,
            adapts,
            slow: 0,
            room: 0,
            room_frames: ROOM_FRAMES.0,
            climbed: false,
        }
    }

    /// Changes to a clip with so many Gaussians in the first layer, the first two, and so on.
    pub(super) fn change_clip(&mut self, layer_ends: Vec<usize>) {
        self.layer_ends = layer_ends;
    }

    /// Number of layers of the clip.
    pub(super) fn layers(&self) -> usize {
        self.layer_ends.len()
    }

    /// How to draw the next frame.
    pub(super) fn settings(&self) -> RenderSettings {
        self.level.settings(self.asked, &self.layer_ends)
    }

    /// Size of the next frame's image, where there is room for `full` pixels.
    pub(super) fn size(&self, full: UVec2) -> UVec2 {
        self.level.size(full)
    }

    /// The level in use.
    pub(super) fn level(&self) -> Level {
        self.level
    }

    /// Whether the GPU does not keep up with the level that was chosen.
    pub(super) fn is_lowered(&self) -> bool {
        self.level > self.chosen
    }

    /// Takes this level, and none better from now on.
    pub(super) fn choose(&mut self, level: Level) {
        (self.chosen, self.level) = (level, level);
        (self.slow, self.room) = (0, 0);
        (self.room_frames, self.climbed) = (ROOM_FRAMES.0, false);
    }

    /// Takes in a frame for which the GPU took `gpu_ms` milliseconds, if it can tell, where the
    /// display shows one every `period_ms`.
    pub(super) fn measure(&mut self, gpu_ms: Option<f64>, period_ms: f64) {
        let Some(load) = gpu_ms.filter(|_| self.adapts && period_ms > 0.0).map(|ms| ms / (SHARE * period_ms))
        else {
            return;
        };
        self.slow = if load > 1.0 { self.slow + 1 } else { 0 };
        self.room = if load < ROOM { self.room + 1 } else { 0 };
        if self.slow >= SLOW_FRAMES && self.level != self.level.coarser() {
            if self.climbed {
                self.room_frames = (2 * self.room_frames).min(ROOM_FRAMES.1);
            }
            self.step(self.level.coarser(), false);
        } else if self.room >= self.room_frames && self.is_lowered() {
            self.step(self.level.better(), true);
        }
    }

    fn step(&mut self, level: Level, climbed: bool) {
        log::info!("quality {}", level.name());
        (self.level, self.climbed, self.slow, self.room) = (level, climbed, 0, 0);
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

    /// Draws frames on a GPU that takes `ms` for each level; how often the level changed.
    fn draw(quality: &mut Quality, frames: usize, ms: [f64; 6]) -> usize {
        (0..frames).fold(0, |changes, _| {
            let before = quality.level();
            quality.measure(Some(ms[before as usize]), PERIOD_MS);
            changes + usize::from(quality.level() != before)
        })
    }

    #[test]
    fn a_fast_gpu_keeps_the_best() {
        let mut quality = quality(Level::Exact);
        assert_eq!(draw(&mut quality, 5000, [8.0, 6.0, 4.0, 3.0, 2.0, 1.0]), 0);
        assert_eq!(quality.settings(), RenderSettings::default());
        assert_eq!(quality.size(UVec2::new(2064, 2208)), UVec2::new(2064, 2208));
    }

    #[test]
    fn a_slow_one_gets_less_and_no_less_than_the_bound() {
        let mut quality = quality(Level::Exact);
        assert_eq!(draw(&mut quality, 5000, [60.0, 50.0, 40.0, 30.0, 25.0, 20.0]), 5);
        assert!(quality.level() == Level::Least && quality.is_lowered());
        let RenderSettings { cutoff, layers, min_contribution_px, .. } = quality.settings();
        assert_eq!((cutoff, layers, min_contribution_px), (Cutoff::Sqrt5, Some(1), 1.0));
        assert_eq!(quality.size(UVec2::new(2064, 2208)), UVec2::new(1240, 1328));
    }

    #[test]
    fn a_single_slow_frame_changes_nothing() {
        let mut quality = quality(Level::Exact);
        for _ in 0..1000 {
            quality.measure(Some(40.0), PERIOD_MS);
            draw(&mut quality, 3, [5.0; 6]);
        }
        assert_eq!(quality.level(), Level::Exact);
    }

    #[test]
    fn room_brings_it_back_but_not_at_once() {
        let mut quality = quality(Level::Exact);
        draw(&mut quality, 10, [20.0, 8.0, 6.0, 6.0, 6.0, 6.0]);
        assert_eq!(quality.level(), Level::Fine, "the face was near");
        draw(&mut quality, 100, [4.0; 6]);
        assert_eq!(quality.level(), Level::Fine);
        draw(&mut quality, 200, [4.0; 6]);
        assert_eq!(quality.level(), Level::Exact);
    }

    #[test]
    fn between_two_levels_it_comes_to_rest() {
        // The better one is too slow, the lower one leaves room: the case that makes pictures waver.
        for above in 0..5 {
            let mut quality = quality(Level::Exact);
            let ms = [0, 1, 2, 3, 4, 5].map(|level| if level <= above { 12.0 } else { 4.0 });
            let early = draw(&mut quality, 1000, ms);
            draw(&mut quality, 20_000, ms);
            let late = draw(&mut quality, 10_000, ms);
            assert!(early >= 3 && late <= 8, "{early} changes in the first 11 s, {late} in 111 s later");
        }
    }

    #[test]
    fn neighbours_that_cost_as_levels_do_are_never_taken_in_turn() {
        // The parts of the cost that the demo has at each level, on GPUs of every speed.
        for fastest in [2.0, 5.0, 9.0, 10.0, 15.0, 30.0, 80.0] {
            let mut quality = quality(Level::Exact);
            let ms = [1.0, 0.74, 0.57, 0.36, 0.26, 0.18].map(|part| part * fastest);
            assert!(draw(&mut quality, 100_000, ms) <= 5, "{fastest} ms");
        }
    }

    #[test]
    fn the_viewer_sets_the_best_to_use() {
        let mut quality = quality(Level::Good);
        draw(&mut quality, 5000, [1.0; 6]);
        assert!(quality.level() == Level::Good && !quality.is_lowered(), "never better than chosen");
        quality.choose(Level::Exact);
        assert_eq!(quality.settings().cutoff, Cutoff::Exact);
        let mut fixed = Quality::new(RenderSettings::default(), Level::Fair, false);
        assert_eq!(draw(&mut fixed, 5000, [99.0; 6]), 0);
        quality.measure(None, PERIOD_MS);
        quality.measure(Some(5.0), 0.0);
        assert_eq!(quality.level(), Level::Exact, "nothing is concluded from nothing");
    }

    #[test]
    fn the_least_level_draws_fewer_layers_than_asked_for() {
        let mut quality =
            Quality::new(RenderSettings { layers: Some(3), ..RenderSettings::default() }, Level::Least, true);
        quality.change_clip(vec![10, 20, 30]);
        assert_eq!(quality.settings().layers, Some(2));
    }
}
