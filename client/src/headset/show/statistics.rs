//! [`Statistics`]: what the panel says about the latest frame.

use glam::UVec2;

use crate::gpu::{Cutoff, FrameCounts, RenderSettings};
use crate::player::TakeCounts;

/// Seconds between updates of the numbers: as fast as they can be read.
const UPDATE_S: f64 = 0.5;

/// Rows of names and values.
#[derive(Default)]
pub(super) struct Statistics {
    pub(super) rows: Vec<(&'static str, String)>,
    age_s: f64,
    pub(super) latest: Option<FrameCost>,
}

/// What a frame drew, what it left out, and how long it took.
pub(super) struct FrameCost {
    pub(super) counts: FrameCounts,
    pub(super) settings: RenderSettings,
    /// Number of layers of the clip.
    pub(super) layers: usize,
    /// Size of an eye's image in pixels.
    pub(super) size: UVec2,
    /// For both eyes; `None` if the GPU has no timestamps.
    pub(super) gpu_ms: Option<f64>,
    pub(super) period_ms: f64,
    /// Counts of the segments of a take.
    pub(super) take: Option<TakeCounts>,
}

impl Statistics {
    /// Updates the rows every half second.
    pub(super) fn refresh(&mut self, elapsed_s: f64) {
        self.age_s += elapsed_s;
        let Some(latest) = self.latest.as_ref().filter(|_| self.age_s >= UPDATE_S) else { return };
        self.age_s = 0.0;
        let FrameCost { counts, settings, layers, size, gpu_ms, period_ms, take } = latest;
        let gpu = gpu_ms.map_or("unknown".into(), |ms| format!("{ms:.1} of {period_ms:.1} ms"));
        let cutoff = match settings.cutoff {
            Cutoff::Exact => "all of it",
            Cutoff::Sqrt8 => "sqrt 8 sigma",
            Cutoff::Sqrt5 => "sqrt 5 sigma",
        };
        self.rows.clear();
        self.rows.extend([
            ("alive now", counts.alive.to_string()),
            ("drawn", counts.sorted.to_string()),
            ("find, sort", format!("{:.2}, {:.2} ms", counts.alive_ms, counts.sort_ms)),
            ("GPU", gpu),
            ("each eye", format!("{} x {} px", size.x, size.y)),
            (
                "sharp",
                settings.inset.map_or("all of it".into(), |side| format!("inner {:.0} %", 100.0 * side)),
            ),
            ("reach", cutoff.into()),
            ("layers", format!("{} of {layers}", settings.layers.unwrap_or(*layers))),
        ]);
        self.rows.extend(take.iter().flat_map(TakeCounts::rows));
    }
}
