//! [`Quality`]: draws as well as the GPU keeps up with.
//!
//! The levels go from the best down; the viewer chooses the best one to use. When the GPU takes
//! longer than its share of a frame for a few frames in a row, the next lower level is taken; when
//! it has had much room for a while, the next higher. A step up that does not last doubles the time
//! until the next one is tried, so that the picture does not waver. The lowest level is a bound on
//! what may be left out: the viewer rather sees frames missing than limbs.

use crate::gpu::{Cutoff, Settings};

/// Part of a frame's time that the GPU may take: the runtime needs the rest.
const SHARE: f64 = 0.8;

/// Part of that below which there is room for the next higher level, which takes up to 1.6 times as
/// long.
const ROOM: f64 = 0.55;

/// Frames in a row that must be too slow, and frames of room that must have passed at first and at
/// most.
const SLOW_FRAMES: u32 = 6;
const ROOM_FRAMES: (u32, u32) = (180, 180 << 4);

/// Names of the levels with every Gaussian, from the best one down.
const NAMES: [&str; 3] = ["Exact", "Fine", "Light"];
const CUTOFFS: [Cutoff; 3] = [Cutoff::Exact, Cutoff::Sqrt8, Cutoff::Sqrt5];

/// What is drawn, and how that follows the GPU.
#[derive(Clone, Debug)]
pub(super) struct Quality {
    settings: Settings,
    /// The best level to use.
    chosen: usize,
    level: usize,
    adapts: bool,
    slow: u32,
    room: u32,
    room_frames: u32,
    /// Whether the latest step went up.
    climbed: bool,
}

impl Quality {
    /// Begins with `settings`. Without `adapts` it follows the viewer only.
    pub(super) fn new(settings: Settings, adapts: bool) -> Quality {
        let level = CUTOFFS.iter().position(|&cutoff| cutoff == settings.cutoff).unwrap_or(0);
        Quality {
            settings,
            chosen: level,
            level,
            adapts,
            slow: 0,
            room: 0,
            room_frames: ROOM_FRAMES.0,
            climbed: false,
        }
    }

    /// How to draw the next frame.
    pub(super) fn settings(&self) -> Settings {
        Settings { cutoff: CUTOFFS[self.level], ..self.settings }
    }

    /// Names of the levels, from the best one down.
    pub(super) fn names(&self) -> &'static [&'static str] {
        &NAMES
    }

    /// Number of the level in use.
    pub(super) fn level(&self) -> usize {
        self.level
    }

    /// Takes the level with this number, or the nearest, and none better from now on.
    pub(super) fn choose(&mut self, level: usize) {
        self.chosen = level.min(CUTOFFS.len() - 1);
        (self.level, self.slow, self.room) = (self.chosen, 0, 0);
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
        if self.slow >= SLOW_FRAMES && self.level + 1 < CUTOFFS.len() {
            if self.climbed {
                self.room_frames = (2 * self.room_frames).min(ROOM_FRAMES.1);
            }
            self.step(self.level + 1, false);
        } else if self.room >= self.room_frames && self.level > self.chosen {
            self.step(self.level - 1, true);
        }
    }

    fn step(&mut self, level: usize, climbed: bool) {
        log::info!("quality {}", NAMES[level]);
        (self.level, self.climbed, self.slow, self.room) = (level, climbed, 0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_MS: f64 = 1000.0 / 90.0;

    /// Draws frames on a GPU that takes `ms` for each level; how often the level changed.
    fn draw(quality: &mut Quality, frames: usize, ms: [f64; 3]) -> usize {
        (0..frames).fold(0, |changes, _| {
            let before = quality.level();
            quality.measure(Some(ms[before]), PERIOD_MS);
            changes + usize::from(quality.level() != before)
        })
    }

    #[test]
    fn a_fast_gpu_keeps_the_best() {
        let mut quality = Quality::new(Settings::default(), true);
        assert_eq!(draw(&mut quality, 5000, [8.0, 6.0, 4.0]), 0);
        assert_eq!(quality.settings(), Settings::default());
    }

    #[test]
    fn a_slow_one_gets_less_and_no_less_than_the_bound() {
        let mut quality = Quality::new(Settings::default(), true);
        draw(&mut quality, 5000, [30.0, 25.0, 20.0]);
        assert_eq!(quality.settings().cutoff, Cutoff::Sqrt5);
        assert_eq!(quality.settings().layers, None, "every Gaussian is still there");
    }

    #[test]
    fn a_single_slow_frame_changes_nothing() {
        let mut quality = Quality::new(Settings::default(), true);
        for _ in 0..1000 {
            quality.measure(Some(40.0), PERIOD_MS);
            draw(&mut quality, 3, [5.0; 3]);
        }
        assert_eq!(quality.level(), 0);
    }

    #[test]
    fn room_brings_it_back_but_not_at_once() {
        let mut quality = Quality::new(Settings::default(), true);
        draw(&mut quality, 10, [20.0, 8.0, 6.0]);
        assert_eq!(quality.level(), 1, "the face was near");
        draw(&mut quality, 100, [4.0; 3]);
        assert_eq!(quality.level(), 1);
        draw(&mut quality, 200, [4.0; 3]);
        assert_eq!(quality.level(), 0);
    }

    #[test]
    fn between_two_levels_it_comes_to_rest() {
        // The better one is too slow, the lower one leaves room: the case that makes pictures waver.
        let mut quality = Quality::new(Settings::default(), true);
        let ms = [12.0, 4.0, 3.0];
        let early = draw(&mut quality, 1000, ms);
        draw(&mut quality, 20_000, ms);
        let late = draw(&mut quality, 10_000, ms);
        assert!(early >= 3 && late <= 8, "{early} changes in the first 11 s, {late} in 111 s later");
    }

    #[test]
    fn the_viewer_sets_the_best_to_use() {
        let mut quality = Quality::new(Settings { cutoff: Cutoff::Sqrt8, ..Settings::default() }, true);
        assert_eq!(quality.level(), 1);
        draw(&mut quality, 5000, [1.0; 3]);
        assert_eq!(quality.level(), 1, "never better than chosen");
        quality.choose(0);
        assert_eq!(quality.settings().cutoff, Cutoff::Exact);
        quality.choose(9);
        assert_eq!(quality.level(), 2);
        let mut fixed = Quality::new(Settings::default(), false);
        assert_eq!(draw(&mut fixed, 5000, [99.0; 3]), 0);
        quality.measure(None, PERIOD_MS);
        quality.measure(Some(5.0), 0.0);
        assert_eq!(quality.level(), 2, "nothing is concluded from nothing");
    }
}
