//! [`Timeline`]: conversion between clip time and frames.

use serde::{Deserialize, Serialize};

/// The frames of a clip, evenly spaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Timeline {
    /// Number of frames, at least 1; the first is at clip time 0, the last at 1.
    pub frames: usize,
}

impl Timeline {
    /// Frame intervals per clip: a time in frames is clip time times this. 1 for a single frame.
    pub fn frames_per_clip(self) -> f64 {
        (self.frames.max(2) - 1) as f64
    }
}
