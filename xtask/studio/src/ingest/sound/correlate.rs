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

/// Blocks are sought in another recording at every fourth sample, with the band in Hz that is left at that rate: a search in
/// an hour takes an eighth of the time. Clocks that differ by 400 ppm part by 3.3 ms in a block of 8 s, as many periods of the
/// highest frequency as in blocks of 4 s in half the whole band.
const SOUGHT_STEP: usize = 4;
const SOUGHT_BAND_HZ: [f64; 2] = [BAND_HZ[0], 1700.0];

/// Samples of a block at that rate, and of the parts in which the other recording is searched.
const BLOCK: usize = 1 << 15;
const PART: usize = 1 << 18;

/// Most blocks that are sought, evenly spread; and a peak over the median after which no other block is.
const SOUGHT_MAX: usize = 32;
const SURE: f64 = 2.0 * CONFIDENCE_MIN;

/// Samples around the lag that is found in which the whole band is searched: 10 ms.
const AROUND: i64 = 160;

/// Cameras up to which all pairs are compared. Of more, those whose numbers differ by a power of two, around the circle.
const ALL_PAIRS_MAX: usize = 24;

/// Samples on each side of a peak in the curve of a pair: 5 ms.
const CURVE_SIDE: i64 = 80;

/// Part of the lags on each side of a peak whose median it is compared with, and the seconds that this is at most.
const NEIGHBOURHOOD: i64 = 16;
const NEIGHBOURHOOD_MAX_S: f64 = 0.5;

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
    /// Number of lags, a power of two.
    len: usize,
    /// Samples from a lag to the next one.
    step: usize,
    band_hz: [f64; 2],
    forward: Arc<dyn RealToComplex<f32>>,
    back: Arc<dyn ComplexToReal<f32>>,
}

/// A peak of a correlation.
#[derive(Clone, Debug)]
pub(super) struct Peak {
    /// Steps of the correlator by which the second recording is later within its track than the first.
    pub(super) lag: f64,
    /// Its height over the median.
    pub(super) confidence: f64,
    /// The correlation around it, over the median.
    pub(super) curve: Vec<f32>,
}

impl Correlator {
    /// For recordings of up to `samples` samples.
    pub(super) fn new(samples: usize) -> Correlator {
        Correlator::stepping((2 * samples).next_power_of_two(), 1, BAND_HZ)
    }

    /// For `len` lags, a power of two, each `step` samples after the last one, by a band that ends below half that rate.
    fn stepping(len: usize, step: usize, band_hz: [f64; 2]) -> Correlator {
        let mut planner = RealFftPlanner::new();
        let (forward, back) = (planner.plan_fft_forward(len * step), planner.plan_fft_inverse(len));
        Correlator { len, step, band_hz, forward, back }
    }

    /// The whitened spectrum of a recording, up to half the rate of the lags.
    pub(super) fn spectrum(&self, mut samples: Vec<f32>) -> Vec<Complex<f32>> {
        samples.resize(self.len * self.step, 0.0);
        let mut spectrum = self.forward.make_output_vec();
        self.forward.process(&mut samples, &mut spectrum).expect("the planned lengths");
        spectrum.truncate(self.len / 2 + 1);
        let bin = |hz: f64| (hz / RATE * (self.len * self.step) as f64) as usize;
        let [low, high] = self.band_hz.map(bin);
        let low = low.max(1);
        for (i, value) in spectrum.iter_mut().enumerate() {
            let norm = value.norm();
            *value = if (low..=high).contains(&i) && norm > 0.0 { *value / norm } else { Complex::default() };
        }
        spectrum
    }

    /// The highest peak of the correlation of two spectra within `range` steps of lag `around` and `overlap` of 0. The
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
        // Negative lags are at the end.
        let value = |lag: i64| correlation[lag as usize & (self.len - 1)];
        let at = |lag: i64| value(lag).abs();
        let overlap = overlap.min(self.len / 2 - 1) as i64;
        let lags = (around - range).max(-overlap)..=(around + range).min(overlap);
        let heights = lags.map(|lag| (at(lag), lag));
        let Some((_, best)) = heights.max_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Peak { lag: around as f64, confidence: 0.0, curve: Vec::new() };
        };
        let side_max = (NEIGHBOURHOOD_MAX_S * RATE) as i64 / self.step as i64;
        let side = (overlap / NEIGHBOURHOOD).min(side_max).max(CURVE_SIDE);
        let mut heights: Vec<f32> = (best - side..=best + side).map(at).collect();
        let middle = heights.len() / 2;
        let (_, median, _) = heights.select_nth_unstable_by(middle, f32::total_cmp);
        let median = median.max(f32::MIN_POSITIVE);
        let fine = |step: i64| {
            let x = step as f64 / FINE as f64;
            let tap = |n: i64| f64::from(value(best + n)) * windowed_sinc(x - n as f64);
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
///
/// # Errors
/// [`Fault::Data`] if a track cannot be read.
pub(super) fn sought([a, b]: [usize; 2], tracks: &[Track]) -> Result<SoundPair, Fault> {
    let is_turned = tracks[a].len > tracks[b].len;
    let (short, long) = if is_turned { (&tracks[b], &tracks[a]) } else { (&tracks[a], &tracks[b]) };
    let correlator = Correlator::stepping(PART, SOUGHT_STEP, SOUGHT_BAND_HZ);
    let (step, block_len) = (SOUGHT_STEP as i64, BLOCK * SOUGHT_STEP);
    // A block is in the middle of a part, so that it can move by as much both ways.
    let side = (PART - BLOCK) / 2;
    let firsts: Vec<i64> = (-(block_len as i64)..long.len as i64).step_by(2 * side * SOUGHT_STEP).collect();
    let part = |first: &i64| Ok((*first, correlator.spectrum(long.samples(*first, PART * SOUGHT_STEP)?)));
    let parts = firsts.par_iter().map(part).collect::<Result<Vec<_>, Fault>>()?;
    let count = short.len.div_ceil(block_len).clamp(1, SOUGHT_MAX);
    let spare = short.len.saturating_sub(block_len);
    // The peak, and the first samples of the block in both.
    let mut best = (Peak { lag: 0.0, confidence: 0.0, curve: Vec::new() }, [0, 0]);
    // From the middle on, where both run most likely.
    let mut blocks: Vec<usize> = (0..count).collect();
    blocks.sort_by_key(|block| block.abs_diff(count / 2));
    for block in blocks {
        let from = (if count > 1 { spare * block / (count - 1) } else { spare / 2 }) as i64;
        let samples = short.samples(from, block_len.min(short.len))?;
        let spectrum = correlator.spectrum([vec![0.0; side * SOUGHT_STEP], samples].concat());
        let peaks = parts.par_iter().map(|(first, part)| {
            let peak = correlator.peak([&spectrum, part], (0, side as i64), side);
            let at = first + (side as i64 + peak.lag.round() as i64) * step;
            (peak, [from, at])
        });
        let found = peaks.collect::<Vec<_>>().into_iter();
        best =
            found.fold(best, |best, found| if found.0.confidence > best.0.confidence { found } else { best });
        if best.0.confidence >= SURE {
            break;
        }
    }
    let (Peak { confidence, .. }, [from, at]) = best;
    // To a part of a sample, by the whole band.
    let correlator = Correlator::new(block_len);
    let spectrum = |track: &Track, from| Ok(correlator.spectrum(track.samples(from, block_len)?));
    let peak = correlator.peak([&spectrum(short, from)?, &spectrum(long, at)?], (0, AROUND), block_len);
    let mut peak = Peak { lag: peak.lag + (at - from) as f64, confidence, ..peak };
    if is_turned {
        peak.lag = -peak.lag;
        peak.curve.reverse();
    }
    Ok(pair([a, b], peak))
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
