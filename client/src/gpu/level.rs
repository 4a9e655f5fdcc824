//! [`Level`]: rendering quality in steps, from exact down to a lower bound.
//!
//! A level changes per-frame parameters only; images and pipelines are shared by all levels. The order follows the
//! error per fragment: first what lies beside the view axis loses resolution, then Gaussians lose their faintest rim,
//! then everything loses resolution, and only at the end do Gaussians lose their edges.

use clap::ValueEnum;
use glam::UVec2;

use super::division::part_size;
use super::settings::{Cutoff, RenderSettings};

/// Rendering quality; the first level is the best.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Level {
    /// All pixels and Gaussians, each drawn to where its alpha falls to 1/255.
    #[default]
    Exact,
    /// An inset of 0.45 of the image's sides: the rest of the image has 0.45 of the resolution.
    Fine,
    /// An inset of 0.4; support radius limited to `sqrt(8)` standard deviations.
    Good,
    /// As `Good`, with 0.85 of the image's sides.
    Fair,
    /// As `Good`, with an inset of 0.35 and 0.8 of the image's sides.
    Light,
    /// As `Light`, with 0.7 of the image's sides and a support radius of at most `sqrt(5)` standard deviations. The
    /// least important layers are dropped if that removes at least a quarter of the Gaussians and leaves at least half.
    Least,
}

/// Parameters of a level.
struct Share {
    /// Fraction of the image's sides.
    side: f32,
    /// See [`RenderSettings::inset`].
    inset: Option<f32>,
    cutoff: Cutoff,
    /// Fraction of the Gaussians that the drawn layers must contain.
    gaussians: f64,
}

/// Layers are dropped only if the rest has at most this fraction of the Gaussians: a smaller saving is
/// more visible than measurable.
const DROP_MAX: f64 = 0.75;

impl Level {
    /// The largest inset of a level.
    pub const INSET_MAX: f32 = 0.45;

    /// All levels, from the best down.
    pub const ALL: [Level; 6] =
        [Level::Exact, Level::Fine, Level::Good, Level::Fair, Level::Light, Level::Least];

    fn share(self) -> Share {
        let (side, inset, cutoff, gaussians) = match self {
            Level::Exact => (1.0, None, Cutoff::Exact, 1.0),
            Level::Fine => (1.0, Some(Level::INSET_MAX), Cutoff::Exact, 1.0),
            Level::Good => (1.0, Some(0.4), Cutoff::Sqrt8, 1.0),
            Level::Fair => (0.85, Some(0.4), Cutoff::Sqrt8, 1.0),
            Level::Light => (0.8, Some(0.35), Cutoff::Sqrt8, 1.0),
            Level::Least => (0.7, Some(0.35), Cutoff::Sqrt5, 0.5),
        };
        Share { side, inset, cutoff, gaussians }
    }

    /// Name in menus and reports.
    pub fn name(self) -> &'static str {
        match self {
            Level::Exact => "Exact",
            Level::Fine => "Fine",
            Level::Good => "Good",
            Level::Fair => "Fair",
            Level::Light => "Light",
            Level::Least => "Least",
        }
    }

    /// The next better level; at the top, the same.
    pub fn better(self) -> Level {
        Level::ALL[(self as usize).saturating_sub(1)]
    }

    /// The next lower level; at the bottom, the same.
    pub fn coarser(self) -> Level {
        Level::ALL[(self as usize + 1).min(Level::ALL.len() - 1)]
    }

    /// `settings` reduced to this level, for a clip with `layer_ends` Gaussians in the first k layers.
    pub fn settings(self, settings: RenderSettings, layer_ends: &[usize]) -> RenderSettings {
        let share = self.share();
        let cutoff = if share.cutoff.radius_max() < settings.cutoff.radius_max() {
            share.cutoff
        } else {
            settings.cutoff
        };
        let layers = match share.gaussians {
            1.0 => settings.layers,
            part => Some(layers_that_hold(part, settings.layers, layer_ends)),
        };
        RenderSettings {
            cutoff,
            layers,
            inset: settings.inset.into_iter().chain(share.inset).reduce(f32::min),
            ..settings
        }
    }

    /// Viewport size in pixels in an image of `full` pixels.
    pub fn size(self, full: UVec2) -> UVec2 {
        let side = self.share().side;
        if side == 1.0 {
            return full;
        }
        part_size(full, side)
    }
}

/// The least number of layers that contain the fraction `part` of the Gaussians in the first `layers`
/// layers, `None` being all. Returns `layers` if that drops too few, see [`DROP_MAX`].
fn layers_that_hold(part: f64, layers: Option<usize>, layer_ends: &[usize]) -> usize {
    let ends = &layer_ends[..layers.unwrap_or(usize::MAX).min(layer_ends.len())];
    let all = ends.last().copied().unwrap_or(0) as f64;
    let fewest = ends.iter().position(|&end| end as f64 >= part * all);
    fewest.filter(|&layer| ends[layer] as f64 <= DROP_MAX * all).map_or(ends.len(), |layer| layer + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYERS: [usize; 4] = [5000, 10_000, 20_000, 40_000];

    fn settings(level: Level) -> RenderSettings {
        level.settings(RenderSettings::default(), &LAYERS)
    }

    #[test]
    fn every_level_reduces_the_one_above() {
        let full = UVec2::new(2064, 2208);
        for pair in Level::ALL.windows(2) {
            let [above, below] = [0, 1].map(|i| (settings(pair[i]), pair[i].size(full)));
            let changes = [
                (above.0.cutoff.radius_max(), below.0.cutoff.radius_max()),
                (above.0.inset.unwrap_or(1.0), below.0.inset.unwrap_or(1.0)),
                (above.1.x as f32, below.1.x as f32),
                (above.1.y as f32, below.1.y as f32),
            ];
            assert!(changes.iter().all(|(above, below)| below <= above), "{pair:?}");
            assert!(changes.iter().any(|(above, below)| below < above), "{pair:?}");
            assert_eq!((pair[0].coarser(), pair[1].better()), (pair[1], pair[0]));
        }
        assert_eq!(settings(Level::Exact), RenderSettings::default());
        assert_eq!((Level::Exact.better(), Level::Least.coarser()), (Level::Exact, Level::Least));
    }

    #[test]
    fn the_last_level_is_the_bound() {
        let least = settings(Level::Least);
        assert_eq!((least.cutoff, least.layers), (Cutoff::Sqrt5, Some(3)));
        assert_eq!(
            (least.inset, Level::Least.size(UVec2::new(2064, 2208))),
            (Some(0.35), UVec2::new(1448, 1544))
        );
    }

    #[test]
    fn half_of_the_gaussians_stay() {
        let layers = |layers, ends: &[usize]| {
            Level::Least.settings(RenderSettings { layers, ..RenderSettings::default() }, ends).layers
        };
        assert_eq!(layers(None, &[5000, 10_000, 20_000, 40_000, 60_000]), Some(4));
        assert_eq!(layers(None, &[5000, 10_000, 20_000, 40_000, 42_978]), Some(5), "too small a saving");
        assert_eq!(layers(Some(2), &LAYERS), Some(1), "half of the requested layers");
        assert_eq!(layers(Some(9), &LAYERS), Some(3));
        assert_eq!(layers(None, &[7]), Some(1));
        assert_eq!(layers(None, &[]), Some(0), "a clip with only a plate");
    }

    #[test]
    fn no_level_exceeds_the_settings() {
        let asked = RenderSettings {
            cutoff: Cutoff::Sqrt5,
            layers: Some(1),
            inset: Some(0.2),
            ..RenderSettings::default()
        };
        for level in Level::ALL {
            assert_eq!(level.settings(asked, &LAYERS), asked, "{level:?}");
        }
    }

    #[test]
    fn sizes_fit_any_image() {
        for full in [UVec2::new(320, 240), UVec2::new(5, 3), UVec2::ONE, UVec2::new(1680, 1760)] {
            for level in Level::ALL {
                let size = level.size(full);
                assert!(size.cmple(full).all() && size.min_element() > 0, "{full} {level:?}: {size}");
            }
        }
        assert_eq!(Level::Least.size(UVec2::new(320, 240)), UVec2::new(224, 168));
    }
}
