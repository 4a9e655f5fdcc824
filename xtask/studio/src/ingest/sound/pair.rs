//! [`SoundPair`] and [`SoundSync`]: what the sound of two cameras says, and the sound of all cameras.

use serde::{Deserialize, Serialize};

/// Samples a second.
pub(in crate::ingest) const RATE: f64 = 16_000.0;

/// Peak of a correlation over its median, from which on it is a match. Noise of an hour stays below 10.
pub(in crate::ingest) const CONFIDENCE_MIN: f64 = 12.0;

/// Drift in parts per million up to which clocks are modelled.
pub(in crate::ingest) const DRIFT_MAX_PPM: f64 = 200.0;

/// When the sound tracks started, and how sure that is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoundSync {
    /// Second at which each file starts, the first at 0, in the middle of the time in which all run.
    pub starts_s: Vec<f64>,
    /// Parts per million by which each clock is slow against the median one.
    pub drifts_ppm: Vec<f64>,
    /// The pairs that were compared.
    pub pairs: Vec<SoundPair>,
}

/// Two sound tracks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoundPair {
    /// Numbers of the cameras.
    pub cameras: [usize; 2],
    /// Seconds by which the second file starts later than the first.
    pub later_s: f64,
    /// Parts per million by which the second clock is slow against the first.
    pub drift_ppm: f64,
    /// Peak of the correlation over its median.
    pub confidence: f64,
    /// Seconds that the solution differs from `later_s`; `None` if the pair was dropped.
    pub residual_s: Option<f64>,
    /// The correlation around its peak, from -5 to 5 ms, over its median.
    pub curve: Vec<f32>,
}
