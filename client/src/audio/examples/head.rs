//! Makes `assets/head.bin` of the measured responses of the KEMAR manikin: `cargo run --release -p client --example head
//! -- MIT_KEMAR_normal_pinna.sofa assets/head.bin`.
//!
//! Each response of the left ear is divided by the mean over all directions, which takes out the loudspeaker and the ear
//! canal of the measurement, is smoothed, becomes one of minimum phase, and is shortened. The delay that this takes out
//! is the delay at which the response below 1.5 kHz correlates most with its remainder (Nam, Abel and Smith, A Method
//! for Estimating Interaural Time Difference for Binaural Synthesis, 2008). The file has the directions in rings from
//! -40 degrees of elevation up, each counterclockwise from the front: a delay in 1/256 samples at 48 kHz, and 96 taps
//! in 1/8192, as little-endian integers of 16 bits. `responses.rs` reads it.

use std::collections::BTreeMap;
use std::error::Error;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::{env, fs, iter};

use sofar::reader::OpenOptions;

/// Rates of the measurement and of the result.
const MEASURED_HZ: f32 = 44_100.0;
const RATE_HZ: f64 = 48_000.0;

/// Length of the discrete Fourier transform, and its number of frequencies from 0 to half of the rate.
const LENGTH: usize = 1024;
const BINS: usize = LENGTH / 2 + 1;

const TAPS: usize = 96;

/// Frequencies between which the levels are those measured: the loudspeaker plays nothing below and above.
const LOWEST_HZ: f64 = 200.0;
const HIGHEST_HZ: f64 = 18_000.0;

/// Half of the width of smoothing, as a share of the frequency.
const SMOOTHING: f64 = 0.08;

/// Bounds of a level relative to the mean.
const LEVELS: [f64; 2] = [0.01, 8.0];

/// Up to which frequency the delay is looked for: above, it is found a period beside.
const DELAY_BELOW_HZ: f64 = 1_500.0;

/// Largest delay in samples, and number of steps in a sample.
const DELAY_MAX: usize = 70;
const DELAY_STEPS: usize = 20;

/// Real and imaginary part at each frequency.
type Spectrum = Vec<[f64; 2]>;

fn main() -> Result<(), Box<dyn Error>> {
    let [measured, out] = &env::args().skip(1).collect::<Vec<_>>()[..] else {
        return Err("usage: head MEASURED.sofa OUT".into());
    };
    let mut options = OpenOptions::new();
    let head = options.sample_rate(MEASURED_HZ).normalized(false).open(measured)?;
    let hrtf = head.hrtf();
    // Rings, each with its directions by tenths of a degree, and their spectra at the left ear.
    let mut rings: BTreeMap<i32, BTreeMap<i32, Spectrum>> = BTreeMap::new();
    let responses = hrtf.data_ir.values.chunks_exact(2 * head.filter_len());
    for (position, ears) in hrtf.source_position.values.chunks_exact(3).zip(responses) {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(position[axis]));
        let elevation = z.atan2(x.hypot(y)).to_degrees().round() as i32;
        let azimuth = (y.atan2(x).to_degrees() * 10.0).round() as i32;
        let spectrum = spectrum(&ears[..head.filter_len()]);
        rings.entry(elevation).or_default().insert(azimuth.rem_euclid(3600), spectrum);
    }
    let mean = mean(&rings);
    let waves: Vec<(f64, f64)> = (0..LENGTH).map(|i| (TAU * i as f64 / LENGTH as f64).sin_cos()).collect();
    let mut bytes = Vec::new();
    for (elevation, ring) in &rings {
        println!("{elevation} degrees: {} directions", ring.len());
        for spectrum in ring.values() {
            let minimal = minimum_phase(&levels(spectrum, &mean), &waves);
            bytes.extend(((delay(spectrum, &mean, &minimal) * 256.0).round() as i16).to_le_bytes());
            for tap in taps(&minimal, &waves) {
                bytes.extend(((tap * 8192.0).round() as i16).to_le_bytes());
            }
        }
    }
    fs::write(out, &bytes)?;
    Ok(())
}

fn bin(hz: f64) -> usize {
    (hz * LENGTH as f64 / RATE_HZ).round() as usize
}

/// The spectrum of a measured response at the frequencies of the result.
fn spectrum(response: &[f32]) -> Spectrum {
    let at = |bin: usize| {
        let turn = -TAU * bin as f64 * RATE_HZ / LENGTH as f64 / f64::from(MEASURED_HZ);
        response.iter().zip(0..).fold([0.0, 0.0], |[re, im], (x, i)| {
            let (sin, cos) = (turn * f64::from(i)).sin_cos();
            [re + f64::from(*x) * cos, im + f64::from(*x) * sin]
        })
    };
    (0..BINS).map(at).collect()
}

/// Root of the mean power over all directions, each weighted by its share of the sphere.
fn mean(rings: &BTreeMap<i32, BTreeMap<i32, Spectrum>>) -> Vec<f64> {
    let (mut power, mut weights) = (vec![0.0; BINS], 0.0);
    for (elevation, ring) in rings {
        let edges = [-5, 5].map(|step| f64::from((elevation + step).min(90)).to_radians().sin());
        let weight = (edges[1] - edges[0]) / ring.len() as f64;
        for spectrum in ring.values() {
            weights += weight;
            power.iter_mut().zip(spectrum).for_each(|(sum, [re, im])| *sum += weight * (re * re + im * im));
        }
    }
    power.into_iter().map(|power| (power / weights).sqrt()).collect()
}

/// The smoothed levels of a spectrum relative to the mean.
fn levels(spectrum: &Spectrum, mean: &[f64]) -> Vec<f64> {
    let power = |bin: usize| (spectrum[bin][0].powi(2) + spectrum[bin][1].powi(2)) / mean[bin].powi(2);
    let level = |bin: usize| {
        let bin = bin.clamp(self::bin(LOWEST_HZ), self::bin(HIGHEST_HZ));
        let half = (bin as f64 * SMOOTHING) as usize;
        let sum: f64 = (bin - half..=bin + half).map(power).sum();
        (sum / (2 * half + 1) as f64).sqrt().clamp(LEVELS[0], LEVELS[1])
    };
    (0..BINS).map(level).collect()
}

/// The spectrum of minimum phase with these levels: the phase is the Hilbert transform of their logarithm, by way of the
/// cepstrum.
fn minimum_phase(levels: &[f64], waves: &[(f64, f64)]) -> Spectrum {
    let logs: Spectrum = levels.iter().map(|level| [level.ln(), 0.0]).collect();
    let cepstrum = inverse(&logs, waves);
    let at = |bin: usize| {
        let phase: f64 = (1..LENGTH / 2).map(|i| -2.0 * cepstrum[i] * waves[bin * i % LENGTH].0).sum();
        [levels[bin] * phase.cos(), levels[bin] * phase.sin()]
    };
    (0..BINS).map(at).collect()
}

/// The first half of the signal of a spectrum.
fn inverse(spectrum: &Spectrum, waves: &[(f64, f64)]) -> Vec<f64> {
    let at = |i: usize| {
        let part = |bin: usize| {
            let (sin, cos) = waves[bin * i % LENGTH];
            spectrum[bin][0] * cos - spectrum[bin][1] * sin
        };
        let within: f64 = (1..LENGTH / 2).map(part).sum();
        (part(0) + part(LENGTH / 2) + 2.0 * within) / LENGTH as f64
    };
    (0..LENGTH / 2).map(at).collect()
}

/// The first taps of a spectrum's signal, which fade out over their last quarter.
fn taps(spectrum: &Spectrum, waves: &[(f64, f64)]) -> Vec<f64> {
    let fade = TAPS / 4;
    let gains = iter::repeat_n(1.0, TAPS - fade)
        .chain((1..=fade).rev().map(|left| (FRAC_PI_2 * left as f64 / (fade + 1) as f64).sin().powi(2)));
    inverse(spectrum, waves).into_iter().zip(gains).map(|(tap, gain)| tap * gain).collect()
}

/// Samples at 48 kHz by which a measured response is later than one of minimum phase.
fn delay(spectrum: &Spectrum, mean: &[f64], minimal: &Spectrum) -> f64 {
    let correlation = |step: &usize| -> f64 {
        let turn = TAU * *step as f64 / DELAY_STEPS as f64 / LENGTH as f64;
        let part = |bin: usize| {
            let ([a, b], [c, d]) = (spectrum[bin], minimal[bin]);
            let (sin, cos) = (turn * bin as f64).sin_cos();
            ((a * c + b * d) * cos - (b * c - a * d) * sin) / mean[bin]
        };
        (bin(LOWEST_HZ)..bin(DELAY_BELOW_HZ)).map(part).sum()
    };
    let best = (0..DELAY_MAX * DELAY_STEPS).max_by(|a, b| correlation(a).total_cmp(&correlation(b)));
    best.unwrap_or(0) as f64 / DELAY_STEPS as f64
}
