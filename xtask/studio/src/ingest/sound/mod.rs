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
mod pair;
mod solve;

use program::Fault;

pub(super) use extract::Track;
pub(super) use pair::{CONFIDENCE_MIN, DRIFT_MAX_PPM, RATE};
pub(super) use pair::{SoundPair, SoundSync};

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
    let size = |group: usize| groups.iter().filter(|other| **other == group).count();
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
