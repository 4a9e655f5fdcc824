//! Compares blocks along the time in which all cameras run: delay and drift of each pair, to a part of a sample.

use program::Fault;
use rayon::prelude::*;
use refine::metrics::median;

use super::correlate::{Correlator, Peak};
use super::extract::Track;
use super::pair::{CONFIDENCE_MIN, RATE, SoundPair};

/// Seconds of a block, a quarter of the time if that is between these. Clocks that drift by 200 ppm part by 0.2 ms within the
/// longest, by which the peak is blurred.
const BLOCK_S: [f64; 2] = [0.5, 1.0];

/// Most blocks, evenly spread.
const BLOCKS_MAX: usize = 24;

/// Seconds around the expected delay that are searched, and what is added for each second of the time in which all run,
/// as the expected one may hold at any instant: 1000 ppm.
const SEARCH_S: f64 = 0.03;
const SEARCH_PER_S: f64 = 1e-3;

/// Seconds between the first and the last block from which on their drift is measured.
const DRIFT_SPAN_S: f64 = 2.0;

/// Deviation of a block from the line of its pair that is always kept, in seconds.
const KEPT_S: f64 = 2e-4;

/// Delay of a pair in a block: the block's middle and the delay in seconds, and the peak.
type BlockDelay = (f64, f64, Peak);

/// The pairs with delays in the middle of the time in which all tracks run, by blocks; `starts_s` are the first estimate.
/// A pair that matches in no block keeps its own.
///
/// # Errors
/// [`Fault::Data`] if a track cannot be read.
pub(super) fn refined(
    tracks: &[Track],
    starts_s: &[f64],
    mut pairs: Vec<SoundPair>,
) -> Result<Vec<SoundPair>, Fault> {
    let begin_s = starts_s.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let ends_s = tracks.iter().zip(starts_s).map(|(track, start_s)| start_s + track.duration_s());
    let end_s = ends_s.fold(f64::INFINITY, f64::min);
    let common_s = end_s - begin_s;
    if common_s < 0.2 {
        return Ok(pairs);
    }
    let block_s = (0.25 * common_s).clamp(BLOCK_S[0], BLOCK_S[1]).min(common_s);
    let blocks = ((common_s / block_s) as usize).clamp(1, BLOCKS_MAX);
    let gap_s = if blocks > 1 { (common_s - block_s) / (blocks - 1) as f64 } else { 0.0 };
    let count = (block_s * RATE) as usize;
    let correlator = Correlator::new(count);
    let mut delays: Vec<Vec<BlockDelay>> = vec![Vec::new(); pairs.len()];
    for block in 0..blocks {
        let from_s = begin_s + block as f64 * gap_s;
        // Whole samples; what rounding leaves is added to the delay.
        let first: Vec<i64> =
            starts_s.iter().map(|start_s| ((from_s - start_s) * RATE).round() as i64).collect();
        let spectra = tracks
            .par_iter()
            .zip(&first)
            .map(|(track, first)| Ok(correlator.spectrum(track.samples(*first, count)?)))
            .collect::<Result<Vec<_>, Fault>>()?;
        let range = ((SEARCH_S + SEARCH_PER_S * common_s) * RATE) as i64;
        let compare = |pair: &SoundPair| {
            let [a, b] = pair.cameras;
            let peak = correlator.peak([&spectra[a], &spectra[b]], (0, range), count / 2);
            let lag = peak.lag + (first[b] - first[a]) as f64;
            (from_s + 0.5 * block_s, -lag / RATE, peak)
        };
        let found: Vec<BlockDelay> = pairs.par_iter().map(compare).collect();
        for (of_pair, delay) in delays.iter_mut().zip(found) {
            if delay.2.confidence >= CONFIDENCE_MIN {
                of_pair.push(delay);
            }
        }
    }
    let middle_s = begin_s + 0.5 * common_s;
    for (pair, mut delays) in pairs.iter_mut().zip(delays) {
        let Some((later_s, slope)) = line(&mut delays, middle_s) else { continue };
        let best = delays.iter().max_by(|a, b| a.2.confidence.total_cmp(&b.2.confidence)).expect("some");
        *pair = SoundPair {
            later_s,
            drift_ppm: slope * 1e6,
            confidence: pair.confidence.max(best.2.confidence),
            curve: best.2.curve.clone(),
            ..*pair
        };
    }
    Ok(pairs)
}

/// Value at `middle_s` and slope of the line through the delays, without those that deviate; `None` of none.
fn line(delays: &mut Vec<BlockDelay>, middle_s: f64) -> Option<(f64, f64)> {
    let times = |delays: &[BlockDelay]| {
        delays
            .iter()
            .map(|delay| delay.0)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)))
    };
    let (first_s, last_s) = times(delays);
    let mut slopes: Vec<f64> = Vec::new();
    for (i, a) in delays.iter().enumerate() {
        slopes.extend(delays[..i].iter().map(|b| (a.1 - b.1) / (a.0 - b.0)));
    }
    let slope = if last_s - first_s >= DRIFT_SPAN_S { median(slopes)? } else { 0.0 };
    let at_middle = |delay: &BlockDelay, slope: f64| delay.1 - slope * (delay.0 - middle_s);
    let value = median(delays.iter().map(|delay| at_middle(delay, slope)).collect())?;
    let off = |delay: &BlockDelay| (at_middle(delay, slope) - value).abs();
    let spread = median(delays.iter().map(off).collect())?;
    delays.retain(|delay| off(delay) <= KEPT_S.max(4.0 * spread));
    let (first_s, last_s) = times(delays);
    let count = delays.len() as f64;
    let mean = |value: &dyn Fn(&BlockDelay) -> f64| delays.iter().map(value).sum::<f64>() / count;
    let (mean_s, mean_delay) = (mean(&|delay| delay.0), mean(&|delay| delay.1));
    let spread = mean(&|delay| (delay.0 - mean_s).powi(2));
    let slope = match last_s - first_s >= DRIFT_SPAN_S {
        true => mean(&|delay| (delay.0 - mean_s) * (delay.1 - mean_delay)) / spread,
        false => 0.0,
    };
    Some((mean_delay + slope * (middle_s - mean_s), slope))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_ignores_what_deviates() {
        let peak = Peak { lag: 0.0, confidence: 50.0, curve: Vec::new() };
        let delay = |t: f64, off: f64| (t, 0.25 + 1e-4 * t + off, peak.clone());
        let mut delays =
            vec![delay(0.0, 0.0), delay(3.0, 0.0), delay(6.0, 0.01), delay(9.0, 0.0), delay(12.0, 0.0)];
        let (value, slope) = line(&mut delays, 6.0).unwrap();
        assert!((value - 0.2506).abs() < 1e-9 && (slope - 1e-4).abs() < 1e-9, "{value} {slope}");
        assert_eq!(delays.len(), 4);
        assert_eq!(line(&mut vec![delay(1.0, 0.0)], 1.0).unwrap().1, 0.0);
        assert!(line(&mut Vec::new(), 0.0).is_none());
    }
}
