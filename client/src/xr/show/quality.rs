//! [`Quality`]: the best level of quality that the GPU keeps up with.
//!
//! The levels go from the best down; the viewer chooses the best one to use. When the GPU exceeds its share
//! of a frame for a few frames in a row, the level drops by one; when it has had room for a while, it rises
//! by one. A rise that does not last doubles the time until the next one, so that the picture does not
//! flicker between levels. `Least` is the floor: below it the player drops frames instead of quality.

use glam::UVec2;

use crate::gpu::{Level, RenderSettings};

/// Share of a frame's time for the GPU's work on the clip: the runtime needs the rest.
const SHARE: f64 = 0.8;

/// Load, relative to that share, below which there is room for the next higher level, which takes up to 1.6
/// times as long.
const ROOM: f64 = 0.55;

/// Frames in a row over the share before a drop, and frames with room before a rise: initially and at
/// most.
const SLOW_FRAMES: u32 = 6;
const ROOM_FRAMES: (u32, u32) = (180, 180 << 4);

/// The level in use, and how it follows the GPU.
#[derive(Clone, Debug)]
pub(in crate::xr) struct Quality {
    /// Settings of the command line: no level draws more.
    asked: RenderSettings,
    /// Number of Gaussians in the first k layers, for each k.
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
    /// Starts at the level `chosen` and draws no more than `asked`. Without `adapts` the level changes only
    /// at the viewer's wish.
    pub(in crate::xr) fn new(asked: RenderSettings, chosen: Level, adapts: bool) -> Quality {
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

    /// Changes to a clip with `layer_ends[k - 1]` Gaussians in its first k layers.
    pub(in crate::xr) fn change_clip(&mut self, layer_ends: Vec<usize>) {
        self.layer_ends = layer_ends;
    }

    /// Number of layers of the clip.
    pub(in crate::xr) fn layers(&self) -> usize {
        self.layer_ends.len()
    }

    /// Settings of the next frame.
    pub(in crate::xr) fn settings(&self) -> RenderSettings {
        self.level.settings(self.asked, &self.layer_ends)
    }

    /// Size of the next frame's viewport in an image of `full` pixels.
    pub(in crate::xr) fn size(&self, full: UVec2) -> UVec2 {
        self.level.size(full)
    }

    /// The level in use.
    pub(in crate::xr) fn level(&self) -> Level {
        self.level
    }

    /// Whether the level is below the chosen one, because the GPU does not keep up.
    pub(in crate::xr) fn is_lowered(&self) -> bool {
        self.level > self.chosen
    }

    /// Changes to this level, the best one from now on.
    pub(in crate::xr) fn choose(&mut self, level: Level) {
        (self.chosen, self.level) = (level, level);
        (self.slow, self.room) = (0, 0);
        (self.room_frames, self.climbed) = (ROOM_FRAMES.0, false);
    }

    /// Takes in the GPU's milliseconds for a frame, if it has timestamps, on a display with one image every
    /// `period_ms`.
    pub(in crate::xr) fn measure(&mut self, gpu_ms: Option<f64>, period_ms: f64) {
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

    /// Draws frames on a GPU that takes `ms` at each level; returns the number of level changes.
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
    fn a_slow_gpu_drops_to_the_floor_and_no_further() {
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
    fn room_raises_the_level_after_a_while() {
        let mut quality = quality(Level::Exact);
        draw(&mut quality, 10, [20.0, 8.0, 6.0, 6.0, 6.0, 6.0]);
        assert_eq!(quality.level(), Level::Fine, "the face was near");
        draw(&mut quality, 100, [4.0; 6]);
        assert_eq!(quality.level(), Level::Fine);
        draw(&mut quality, 200, [4.0; 6]);
        assert_eq!(quality.level(), Level::Exact);
    }

    #[test]
    fn between_two_levels_it_settles() {
        // The better one is too slow and the lower one leaves room: the case that makes pictures flicker.
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
    fn levels_with_the_costs_of_the_demo_never_alternate() {
        // Relative cost of the demo at each level, on GPUs of every speed.
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
        assert_eq!(quality.level(), Level::Exact, "without a measurement nothing changes");
    }

    #[test]
    fn the_least_level_draws_fewer_layers_than_asked_for() {
        let mut quality =
            Quality::new(RenderSettings { layers: Some(3), ..RenderSettings::default() }, Level::Least, true);
        quality.change_clip(vec![10, 20, 30]);
        assert_eq!(quality.settings().layers, Some(2));
    }
}
