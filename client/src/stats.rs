//! What `--stats` writes, and the summary of many timings.

use serde::Serialize;

/// Counts and timings of a rendering.
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
    /// Number of passes that the eyes took.
    pub passes: usize,
    /// Gaussians in the clip, plate included.
    pub gaussians: usize,
    /// GPU memory that the clip takes, in bytes.
    pub gpu_bytes: u64,
    /// Pipelines built for drawing.
    pub pipelines: usize,
    /// How long the clip took to arrive.
    pub loading: LoadingStats,
    /// Milliseconds for packing and uploading the clip.
    pub upload_ms: f64,
    /// Whether `draw_ms` was measured by the GPU; else it is the time until the GPU was done.
    pub gpu_timed: bool,
    /// Over the frames.
    pub alive_ms: Summary,
    /// Over the frames.
    pub sort_ms: Summary,
    /// Over the frames.
    pub draw_ms: Summary,
    /// Every frame.
    pub frames: Vec<FrameStats>,
}

/// Milliseconds from the start of loading a clip, decoding included.
#[derive(Clone, Debug, Serialize)]
pub struct LoadingStats {
    /// Until something of it could be played.
    pub playable_ms: f64,
    /// Until all of it was there.
    pub whole_ms: f64,
}

/// Counts and timings of a frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameStats {
    /// Seconds from the start of the clip.
    pub time: f64,
    /// Gaussians whose opacity at the instant reaches 1/255.
    pub alive: u32,
    /// Those that can reach into an image.
    pub sorted: u32,
    /// Those whose rectangle holds a pixel centre.
    pub drawn: u32,
    /// Pixel centres in the rectangles, over all Gaussians and eyes.
    pub fragments: u64,
    /// Milliseconds for finding them.
    pub alive_ms: f64,
    /// Milliseconds for sorting them.
    pub sort_ms: f64,
    /// Milliseconds for drawing them.
    pub draw_ms: f64,
}

/// The middle and the bad end of several numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Half are no larger.
    pub median: f64,
    /// 95 % are no larger.
    pub p95: f64,
}

impl Summary {
    /// Of `values`, in any order; 0 where there are none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Summary {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        // The smallest value that at least the given part of all is no larger than.
        let at = |part: f64| {
            let rank = (part * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Summary { median: at(0.5), p95: at(0.95) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summary_by_rank() {
        assert_eq!(Summary::of((1..=100).rev().map(f64::from)), Summary { median: 50.0, p95: 95.0 });
        assert_eq!(Summary::of([3.0, 1.0, 2.0]), Summary { median: 2.0, p95: 3.0 });
        assert_eq!(Summary::of([]), Summary::default());
    }
}
