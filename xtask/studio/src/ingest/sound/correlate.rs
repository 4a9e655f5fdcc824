//! Whitened cross-correlation (GCC-PHAT; Knapp and Carter 1976) of sound tracks.
//!
//! Each spectrum is divided by its magnitude within the band. So the correlation has one sharp peak, for any spectrum
//! of the sound and of the microphones.

use std::f64::consts::PI;
use std::sync::Arc;

use program::Fault;
use rayon::prelude::*;
use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use super::extract::Track;
use super::pair::{CONFIDENCE_MIN, RATE, SoundPair};

/// Band in Hz: below are hums, above little of a voice.
const BAND_HZ: [f64; 2] = [150.0, 7000.0];

/// Seconds from the start of each recording that are compared as a whole.
const WHOLE_S: f64 = 120.0;

/// Samples of a block that is sought in another recording: 4 s, in which clocks that differ by 400 ppm part by 1.6 ms. The
/// recording is searched in parts, each for as many lags as the second number says.
const BLOCK: usize = 1 << 16;
const LAGS: usize = 1 << 17;

/// Most blocks that are sought, evenly spread; and a peak over the median after which no other block is.
const SOUGHT_MAX: usize = 64;
const SURE: f64 = 2.0 * CONFIDENCE_MIN;

/// Cameras up to which all pairs are compared. Of more, those whose numbers differ by a power of two, around the circle.
const ALL_PAIRS_MAX: usize = 24;

/// Samples on each side of a peak in the curve of a pair: 5 ms.
const CURVE_SIDE: i64 = 80;

/// Part of the lags, on each side of a peak, whose median it is compared with.
const NEIGHBOURHOOD: i64 = 16;

/// Largest number of samples over which a median is taken.
const MEDIAN_OF: usize = 1 << 15;

/// Steps of a sample between which the vertex of a peak is sought, and samples on each side that interpolate it: the band
/// ends below half the rate.
const FINE: i64 = 8;
const TAPS: i64 = 24;

/// The weight of a sample at a distance of `x` samples.
fn windowed_sinc(x: f64) -> f64 {
    let window = 0.5 + 0.5 * libm::cos(PI * (x / (TAPS + 2) as f64).clamp(-1.0, 1.0));
    if x == 0.0 { 1.0 } else { window * libm::sin(PI * x) / (PI * x) }
}

/// Spectra of a length, and back.
pub(super) struct Correlator {
    len: usize,
    forward: Arc<dyn RealToComplex<f32>>,
    back: Arc<dyn ComplexToReal<f32>>,
}

/// A peak of a correlation.
#[derive(Clone, Debug)]
pub(super) struct Peak {
    /// Samples by which the second recording is later within its track than the first.
    pub(super) lag: f64,
    /// Its height over the median.
    pub(super) confidence: f64,
    /// The correlation around it, over the median.
    pub(super) curve: Vec<f32>,
}

impl Correlator {
    /// For recordings of up to `samples` samples.
    pub(super) fn new(samples: usize) -> Correlator {
        let len = (2 * samples).next_power_of_two();
        let mut planner = RealFftPlanner::new();
        Correlator { len, forward: planner.plan_fft_forward(len), back: planner.plan_fft_inverse(len) }
    }

    /// The whitened spectrum of a recording.
    pub(super) fn spectrum(&self, mut samples: Vec<f32>) -> Vec<Complex<f32>> {
        samples.resize(self.len, 0.0);
        let mut spectrum = self.forward.make_output_vec();
        self.forward.process(&mut samples, &mut spectrum).expect("the planned lengths");
        let bin = |hz: f64| (hz / RATE * self.len as f64) as usize;
        let (low, high) = (bin(BAND_HZ[0]).max(1), bin(BAND_HZ[1]));
        for (i, value) in spectrum.iter_mut().enumerate() {
            let norm = value.norm();
            *value = if (low..=high).contains(&i) && norm > 0.0 { *value / norm } else { Complex::default() };
        }
        spectrum
    }

    /// The highest peak of the correlation of two spectra within `range` samples of lag `around` and `overlap` of 0. The
    /// median is that around the peak: recordings that overlap less have a lower correlation, so one over all lags is too low.
    pub(super) fn peak(
        &self,
        [a, b]: [&[Complex<f32>]; 2],
        (around, range): (i64, i64),
        overlap: usize,
    ) -> Peak {
        let mut product: Vec<Complex<f32>> = a.iter().zip(b).map(|(a, b)| a.conj() * b).collect();
        let mut correlation = self.back.make_output_vec();
        self.back.process(&mut product, &mut correlation).expect("the planned lengths, real at both ends");
        let at = |lag: i64| correlation[lag.rem_euclid(self.len as i64) as usize].abs();
        let overlap = overlap.min(self.len / 2 - 1) as i64;
        let lags = (around - range).max(-overlap)..=(around + range).min(overlap);
        let Some(best) = lags.max_by(|a, b| at(*a).total_cmp(&at(*b))) else {
            return Peak { lag: around as f64, confidence: 0.0, curve: Vec::new() };
        };
        let side = (overlap / NEIGHBOURHOOD).max(CURVE_SIDE);
        let step = (2 * side as usize / MEDIAN_OF).max(1);
        let mut heights: Vec<f32> = (best - side..=best + side).step_by(step).map(at).collect();
        let middle = heights.len() / 2;
        let (_, median, _) = heights.select_nth_unstable_by(middle, f32::total_cmp);
        let median = median.max(f32::MIN_POSITIVE);
        let fine = |step: i64| {
            let x = step as f64 / FINE as f64;
            let tap = |n: i64| {
                let value = correlation[(best + n).rem_euclid(self.len as i64) as usize];
                f64::from(value) * windowed_sinc(x - n as f64)
            };
            (-TAPS..=TAPS).map(tap).sum::<f64>().abs()
        };
        let step = (-FINE..=FINE).max_by(|a, b| fine(*a).total_cmp(&fine(*b))).expect("some");
        let [before, top, after] = [step - 1, step, step + 1].map(fine);
        // The vertex of the parabola through three points.
        let bend = before - 2.0 * top + after;
        let vertex = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        let shift = (step as f64 + vertex) / FINE as f64;
        Peak {
            lag: best as f64 + shift,
            confidence: top / f64::from(median),
            curve: (best - CURVE_SIDE..=best + CURVE_SIDE).map(|lag| at(lag) / median).collect(),
        }
    }
}

/// The pairs of this many tracks that are compared.
pub(super) fn pairs(tracks: usize) -> Vec<[usize; 2]> {
    let is_compared = |[a, b]: &[usize; 2]| {
        let apart = (b - a).min(tracks - (b - a));
        tracks <= ALL_PAIRS_MAX || apart.is_power_of_two()
    };
    let all = (0..tracks).flat_map(|a| (a + 1..tracks).map(move |b| [a, b]));
    all.filter(is_compared).collect()
}

/// Compares the starts of all tracks.
pub(super) fn whole(tracks: &[Track]) -> Result<Vec<SoundPair>, Fault> {
    let longest = tracks.iter().map(|track| track.len).max().unwrap_or(0).min((WHOLE_S * RATE) as usize);
    let correlator = Correlator::new(longest.max(16));
    let spectra = tracks
        .par_iter()
        .map(|track| Ok(correlator.spectrum(track.samples(0, longest)?)))
        .collect::<Result<Vec<_>, Fault>>()?;
    let compare = |[a, b]: [usize; 2]| {
        pair([a, b], correlator.peak([&spectra[a], &spectra[b]], (0, longest as i64), longest))
    };
    Ok(pairs(tracks.len()).into_par_iter().map(compare).collect())
}

/// The pair of two cameras with this peak.
fn pair(cameras: [usize; 2], peak: Peak) -> SoundPair {
    // What comes earlier within a track began to be recorded later.
    let later_s = -peak.lag / RATE;
    SoundPair {
        cameras,
        later_s,
        drift_ppm: 0.0,
        confidence: peak.confidence,
        residual_s: None,
        curve: peak.curve,
    }
}

/// Seeks blocks of the shorter track of a pair, which may start at any time in the other: clocks that drift blur the peak
/// of whole recordings, and recordings may share little of their beginnings.
pub(super) fn sought([a, b]: [usize; 2], tracks: &[Track]) -> Result<SoundPair, Fault> {
    let is_turned = tracks[a].len > tracks[b].len;
    let (short, long) = if is_turned { (&tracks[b], &tracks[a]) } else { (&tracks[a], &tracks[b]) };
    let correlator = Correlator::new(LAGS);
    let mut parts = Vec::new();
    for first in (-(BLOCK as i64)..long.len as i64).step_by(LAGS) {
        parts.push((first, correlator.spectrum(long.samples(first, 2 * LAGS)?)));
    }
    let count = short.len.div_ceil(BLOCK).clamp(1, SOUGHT_MAX);
    let spare = short.len.saturating_sub(BLOCK);
    let mut best = Peak { lag: 0.0, confidence: 0.0, curve: Vec::new() };
    // From the middle on, where both run most likely.
    let mut blocks: Vec<usize> = (0..count).collect();
    blocks.sort_by_key(|block| block.abs_diff(count / 2));
    for block in blocks {
        let from = if count > 1 { spare * block / (count - 1) } else { spare / 2 };
        let spectrum = correlator.spectrum(short.samples(from as i64, BLOCK.min(short.len))?);
        for (first, part) in &parts {
            let half = LAGS as i64 / 2;
            let peak = correlator.peak([&spectrum, part], (half, half), LAGS);
            if peak.confidence > best.confidence {
                best = Peak { lag: peak.lag + (first - from as i64) as f64, ..peak };
            }
        }
        if best.confidence >= SURE {
            break;
        }
    }
    if is_turned {
        best.lag = -best.lag;
        best.curve.reverse();
    }
    Ok(pair([a, b], best))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_cameras_are_compared_with_some() {
        assert_eq!(pairs(3), [[0, 1], [0, 2], [1, 2]]);
        assert_eq!(pairs(24).len(), 24 * 23 / 2);
        let many = pairs(48);
        assert!(many.len() < 48 * 6 && many.contains(&[0, 47]) && many.contains(&[3, 19]), "{}", many.len());
    }

    #[test]
    fn a_shift_by_a_part_of_a_sample_is_found() {
        // Two sines a sample apart would alias; band-limited noise does not.
        let mut noise = 7u64;
        let mut random = || {
            noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (noise >> 40) as f32 / (1u64 << 24) as f32 - 0.5
        };
        let tones: Vec<(f32, f32)> =
            (0..400).map(|_| (0.06 + 2.6 * (random() + 0.5), 6.3 * random())).collect();
        let sound = |shift: f32| -> Vec<f32> {
            let at = |i: usize| tones.iter().map(|(w, p)| (w * (i as f32 - shift) + p).sin()).sum();
            (0..4000).map(at).collect()
        };
        let correlator = Correlator::new(4000);
        let [a, b] = [sound(0.0), sound(12.3)].map(|sound| correlator.spectrum(sound));
        let peak = correlator.peak([&a, &b], (0, 4000), 4000);
        assert!((peak.lag - 12.3).abs() < 0.05 && peak.confidence > 20.0, "{peak:?}");
        let near = correlator.peak([&a, &b], (100, 20), 4000);
        assert!((80.0..=120.0).contains(&near.lag) && near.confidence < 0.1 * peak.confidence, "{near:?}");
    }

    #[test]
    fn noise_matches_no_noise() {
        let folder = tempfile::tempdir().unwrap();
        let mut state = 5u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
        };
        for seconds in [1, 10, 60] {
            let tracks: Vec<Track> = (0..6)
                .map(|i| {
                    let samples: Vec<f32> = (0..seconds * 16_000).map(|_| 2e4 * random()).collect();
                    Track::from_samples(folder.path().join(i.to_string()), &samples)
                })
                .collect();
            let highest = whole(&tracks).unwrap().iter().map(|pair| pair.confidence).fold(0.0, f64::max);
            println!("{seconds} s: {highest:.1}");
            assert!((5.0..0.9 * CONFIDENCE_MIN).contains(&highest), "{highest}");
            let highest = sought([0, 1], &tracks).unwrap().confidence;
            assert!((5.0..0.9 * CONFIDENCE_MIN).contains(&highest), "{highest} of blocks");
        }
    }
}
