//! Finds when videos started by their sound.
//!
//! ```text
//! extract:   ffmpeg -> 16 kHz, one channel, kept in a file
//! correlate: whitened cross-correlation (GCC-PHAT) of all pairs, first whole recordings, then blocks along the time in which
//!            all run -> delay and drift of each pair
//! solve:     least squares over the pairs, without those that contradict the others -> start and drift of each camera
//! ```
//!
//! Sound needs 2.9 ms for a metre. So a start by sound is late by the way from the sound to the microphone, which nothing here
//! knows: cameras at different distances, up to 10 m, differ by up to 29 ms. The fit learns the rest.

mod blocks;
mod correlate;
mod extract;
mod solve;

use program::Fault;
use serde::{Deserialize, Serialize};

pub(super) use extract::Track;

/// Samples a second.
pub(super) const RATE: f64 = 16_000.0;

/// Peak of a correlation over its median, from which on it is a match. Noise of any length stays below 9.
pub(super) const CONFIDENCE_MIN: f64 = 12.0;

/// Drift in parts per million up to which clocks are modelled.
pub(super) const DRIFT_MAX_PPM: f64 = 200.0;

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

/// Compares all pairs of `tracks` and solves for their starts; `name` names a camera in messages.
///
/// # Errors
/// [`Fault::Data`] if a track matches none of the others.
pub(super) fn synchronise(tracks: &[Track], name: &dyn Fn(usize) -> String) -> Result<SoundSync, Fault> {
    let coarse = correlate::whole(tracks)?;
    check_connected(tracks.len(), &coarse, name)?;
    let starts_s = solve::starts(tracks.len(), &coarse).values;
    let mut pairs = blocks::refined(tracks, &starts_s, coarse)?;
    check_connected(tracks.len(), &pairs, name)?;
    let solution = solve::starts(tracks.len(), &pairs);
    for (pair, residual_s) in pairs.iter_mut().zip(solution.residuals) {
        pair.residual_s = residual_s;
    }
    Ok(SoundSync { starts_s: solution.values, drifts_ppm: solve::drifts(tracks.len(), &pairs), pairs })
}

/// Checks that pairs that match join all cameras.
fn check_connected(cameras: usize, pairs: &[SoundPair], name: &dyn Fn(usize) -> String) -> Result<(), Fault> {
    let groups = solve::groups(cameras, pairs.iter().filter(|pair| pair.confidence >= CONFIDENCE_MIN));
    let size = |group: usize| groups.iter().filter(|of| **of == group).count();
    let largest = (0..cameras).max_by_key(|group| (size(*group), usize::MAX - group)).unwrap_or(0);
    let Some(outside) = (0..cameras).find(|camera| groups[*camera] != largest) else { return Ok(()) };
    let across = pairs.iter().filter(|pair| {
        let [a, b] = pair.cameras.map(|camera| groups[camera] == groups[outside]);
        a != b
    });
    let best = across.map(|pair| pair.confidence).fold(0.0, f64::max);
    Err(Fault::Data(format!(
        "{}: its sound is not that of the other cameras: the correlation peaks at {best:.1} times its median, and {CONFIDENCE_MIN} \
         are needed; state when the videos start with --offsets FILE",
        name(outside)
    )))
}
