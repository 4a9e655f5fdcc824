//! The statistics that `--stats` writes, and [`Summary`] of timings.

use serde::Serialize;

use crate::player::TakeCounts;

/// Counts and timings of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Stats {
    /// Name of the adapter.
    pub adapter: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Width of an eye's image in pixels.
    pub width: u32,
    /// Height of an eye's image in pixels.
    pub height: u32,
    /// Number of eyes.
    pub eyes: usize,
    /// Render passes per frame.
    pub passes: usize,
    /// Gaussians of the clip, with its plate.
    pub gaussians: usize,
    /// GPU memory of the clip in bytes.
    pub gpu_bytes: u64,
    /// The segments of a take; absent for a clip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub take: Option<TakeStats>,
    /// Number of pipelines.
    pub pipelines: usize,
    /// Time to load the clip.
    pub loading: LoadingStats,
    /// Milliseconds until all that is drawn first was decoded, packed and in GPU memory.
    pub upload_ms: f64,
    /// Whether GPU timestamps measured `draw_ms` of all frames; else it is the wall time until the GPU finished.
    pub gpu_timed: bool,
    /// Whether the fragment stage calculated in f16; else in f32.
    pub f16: bool,
    /// `alive_ms` over the frames.
    pub alive_ms: Summary,
    /// `sort_ms` over the frames.
    pub sort_ms: Summary,
    /// `draw_ms` over the frames.
    pub draw_ms: Summary,
    /// The frames.
    pub frames: Vec<FrameStats>,
}

/// Counts of the segments of a take.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TakeStats {
    /// Number of segments.
    pub segments: usize,
    /// Number of segments in GPU memory at the end.
    pub resident: usize,
    /// Number of segments that were loaded, again ones included.
    pub loaded: usize,
    /// Seconds from the last position that play on without loading.
    pub buffered_s: f64,
    /// Most layers of a segment that were loaded while the take played, as the network allowed.
    pub layers: usize,
    /// Most bytes uploaded in a frame.
    pub uploaded_bytes_max: usize,
}

impl From<TakeCounts> for TakeStats {
    fn from(counts: TakeCounts) -> TakeStats {
        let TakeCounts { segments, resident, loaded, buffered_s, layers, uploaded_bytes_max, .. } = counts;
        TakeStats { segments, resident, loaded, buffered_s, layers, uploaded_bytes_max }
    }
}

/// Milliseconds from the start of loading a clip, with decoding.
#[derive(Clone, Debug, Serialize)]
pub struct LoadingStats {
    /// Until its first layer played.
    pub playable_ms: f64,
    /// Until it was complete.
    pub whole_ms: f64,
}

/// Counts and timings of a frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameStats {
    /// Seconds from the start of the clip.
    pub time: f64,
    /// Gaussians whose opacity at this time reaches 1/255.
    pub alive: u32,
    /// Gaussians inside a view frustum.
    pub sorted: u32,
    /// Gaussians whose quad covers a pixel centre of an eye.
    pub drawn: u32,
    /// Pixel centres covered by quads, over all Gaussians and eyes.
    pub fragments: u64,
    /// Milliseconds to select the alive Gaussians.
    pub alive_ms: f64,
    /// Milliseconds to sort.
    pub sort_ms: f64,
    /// Milliseconds to draw what is uploaded: on the GPU, or the wall time.
    pub draw_ms: f64,
}

/// Median and 95th percentile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// The 50th percentile.
    pub median: f64,
    /// The 95th percentile.
    pub p95: f64,
}

impl Summary {
    /// Summarises `values` in any order by nearest rank; 0 if there are none.
    pub fn new(values: impl IntoIterator<Item = f64>) -> Summary {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |fraction: f64| {
            let rank = (fraction * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Summary { median: at(0.5), p95: at(0.95) }
    }
}

/// The latest `N` numbers of a series.
#[cfg(any(feature = "window", feature = "xr"))]
#[derive(Debug, Default)]
pub(crate) struct Latest<const N: usize> {
    pub(crate) values: Vec<f64>,
    /// Index of the oldest one once there are `N`.
    next: usize,
}

#[cfg(any(feature = "window", feature = "xr"))]
impl<const N: usize> Latest<N> {
    pub(crate) fn push(&mut self, value: f64) {
        if self.values.len() < N {
            self.values.push(value);
        } else {
            self.values[self.next] = value;
            self.next = (self.next + 1) % N;
        }
    }

    /// Their summary; `None` before the first.
    pub(crate) fn summary(&self) -> Option<Summary> {
        (!self.values.is_empty()).then(|| Summary::new(self.values.iter().copied()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(any(feature = "window", feature = "xr"))]
    #[test]
    fn only_the_latest_numbers_count() {
        let mut latest = Latest::<100>::default();
        assert_eq!(latest.summary(), None);
        (0..107).for_each(|_| latest.push(1.0));
        (0..99).for_each(|_| latest.push(10.0));
        assert_eq!(latest.values.len(), 100);
        assert_eq!(latest.values.iter().filter(|&&value| value == 1.0).count(), 1);
        assert_eq!(latest.summary(), Some(Summary { median: 10.0, p95: 10.0 }));
    }

    #[test]
    fn summary_by_rank() {
        assert_eq!(Summary::new((1..=100).rev().map(f64::from)), Summary { median: 50.0, p95: 95.0 });
        assert_eq!(Summary::new([3.0, 1.0, 2.0]), Summary { median: 2.0, p95: 3.0 });
        assert_eq!(Summary::new([]), Summary::default());
    }
}
