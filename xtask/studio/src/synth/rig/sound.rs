//! [`Sound`]: a clap and noise like speech from a place on the stage, and what the microphone of a camera records.
//!
//! Both are white noise limited to a band, times an envelope. The noise is defined at every instant: random numbers on an
//! even lattice of times, interpolated by the impulse response of the band. So each microphone hears the same sound at
//! instants of its own, without resampling.

use std::f64::consts::PI;
use std::io::{self, Write};

use glam::DVec3;

use super::draws::normal;
use super::perturbations::CameraErrors;
use crate::synth::stage::{split_mix, unit};

/// Samples a second.
pub(super) const RATE: u32 = 48_000;

/// Speed of sound in metres per second.
pub(super) const SPEED_M_S: f64 = 343.0;

/// When the clap is, when all cameras run.
pub(super) const CLAP_S: f64 = 0.4;

/// Where the sound comes from: within these distances of the point, in metres.
const PLACE: [f64; 3] = [0.0, 1.4, 0.0];
const PLACE_RANGE: [f64; 3] = [1.2, 0.2, 1.2];

/// Random numbers a second, edges of the band in cycles per number (300 to 4800 Hz), and numbers on each side that count.
const LATTICE: f64 = 12_000.0;
const BAND: [f64; 2] = [0.025, 0.4];
const SIDE: usize = 24;

/// Entries of the table of the impulse response per lattice number.
const TABLE_STEPS: usize = 64;

/// Amplitudes of clap and speech; how fast the clap rises and decays, in seconds.
const CLAP: f64 = 0.25;
const CLAP_RISE_S: f64 = 3e-4;
const CLAP_DECAY_S: f64 = 6e-3;
const SPEECH: f64 = 0.08;

/// Mean interval of syllables in seconds, the fraction that is a pause, and the range of half their length.
const SYLLABLE_S: f64 = 0.21;
const PAUSES: f64 = 0.2;
const HALF_SYLLABLE_S: [f64; 2] = [0.06, 0.13];

/// The sound of a stage.
#[derive(Clone, Debug)]
pub(super) struct Sound {
    /// Where it comes from, in metres.
    pub(super) place: [f64; 3],
    seed: u64,
    /// The impulse response of the band, from 0 to [`SIDE`].
    response: Vec<f64>,
}

impl Sound {
    /// The sound with three numbers from -1 to 1 that say where it comes from.
    pub(super) fn at(place: [f64; 3], seed: u64) -> Sound {
        let place = [0, 1, 2].map(|axis| PLACE[axis] + PLACE_RANGE[axis] * place[axis]);
        let sinc = |x: f64, f: f64| if x == 0.0 { 2.0 * f } else { libm::sin(2.0 * PI * f * x) / (PI * x) };
        let response = |i: usize| {
            let x = i as f64 / TABLE_STEPS as f64;
            let window = 0.5 + 0.5 * libm::cos(PI * x / SIDE as f64);
            window * (sinc(x, BAND[1]) - sinc(x, BAND[0]))
        };
        // One more, for the interpolation at the end.
        Sound { place, seed, response: (0..=SIDE * TABLE_STEPS + 1).map(response).collect() }
    }

    /// Seconds that the sound takes to a point.
    pub(super) fn delay_s(&self, to: [f64; 3]) -> f64 {
        DVec3::from(self.place).distance(DVec3::from(to)) / SPEED_M_S
    }

    /// The sound at an instant at its place.
    fn value(&self, time_s: f64) -> f64 {
        let envelope = CLAP * clap(time_s - CLAP_S) + SPEECH * self.speech(time_s);
        if envelope == 0.0 { 0.0 } else { envelope * self.noise(time_s) }
    }

    /// Noise in the band.
    fn noise(&self, time_s: f64) -> f64 {
        let at = time_s * LATTICE;
        let first = at.floor() as i64 - SIDE as i64 + 1;
        let tap = |number: i64| {
            let x = (at - number as f64).abs() * TABLE_STEPS as f64;
            let entry = (x as usize).min(SIDE * TABLE_STEPS);
            let (a, b) = (self.response[entry], self.response[entry + 1]);
            (a + (b - a) * (x - entry as f64)) * normal(split_mix(self.seed) ^ number as u64)
        };
        (first..first + 2 * SIDE as i64).map(tap).sum()
    }

    /// Envelope of speech, from 0 to 1: bumps of different heights and lengths, and pauses.
    fn speech(&self, time_s: f64) -> f64 {
        let number = (time_s / SYLLABLE_S).floor() as i64;
        let syllable = |number: i64| {
            let drawn = |kind: u64| {
                let key = split_mix(split_mix(self.seed ^ 0x7370_6565_6368) ^ number as u64);
                unit(split_mix(key ^ kind))
            };
            let center = (number as f64 + 0.25 + 0.5 * drawn(0)) * SYLLABLE_S;
            let half = HALF_SYLLABLE_S[0] + (HALF_SYLLABLE_S[1] - HALF_SYLLABLE_S[0]) * drawn(1);
            let off = (time_s - center).abs() / half;
            if drawn(2) < PAUSES || off >= 1.0 {
                return 0.0;
            }
            (0.4 + 0.6 * drawn(3)) * (0.5 + 0.5 * libm::cos(PI * off))
        };
        (number - 1..=number + 1).map(syllable).sum()
    }
}

/// Envelope of the clap, from 0 to 1.
fn clap(since_s: f64) -> f64 {
    match since_s {
        ..0.0 => 0.0,
        ..CLAP_RISE_S => since_s / CLAP_RISE_S,
        ..1.0 => libm::exp(-(since_s - CLAP_RISE_S) / CLAP_DECAY_S),
        _ => 0.0,
    }
}

/// The microphone of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Microphone<'a> {
    pub(super) sound: &'a Sound,
    pub(super) errors: &'a CameraErrors,
    /// Seconds that the sound takes to it.
    pub(super) delay_s: f64,
    /// Power of the sound relative to the noise, in decibels.
    pub(super) noise_db: Option<f64>,
    /// Number of the camera, on which the noise depends.
    pub(super) camera: usize,
}

impl Microphone<'_> {
    /// The sound in the sample with this number, without noise.
    fn sample(&self, number: usize) -> f64 {
        let recorded_s = number as f64 / f64::from(RATE);
        let arrived_s = self.errors.time_s(recorded_s - self.errors.sound_skew_s);
        self.sound.value(arrived_s - self.delay_s)
    }

    /// Writes `samples` samples as a WAV file: one channel of 16 bits.
    ///
    /// # Errors
    /// Those of `file`.
    pub(super) fn write_wav(&self, samples: usize, file: &mut impl Write) -> io::Result<()> {
        let bytes = 2 * samples as u32;
        for part in [&b"RIFF"[..], &(36 + bytes).to_le_bytes(), b"WAVEfmt ", &16u32.to_le_bytes()] {
            file.write_all(part)?;
        }
        // PCM, one channel.
        [1u16, 1].iter().try_for_each(|x| file.write_all(&x.to_le_bytes()))?;
        [RATE, 2 * RATE].iter().try_for_each(|x| file.write_all(&x.to_le_bytes()))?;
        [2u16, 16].iter().try_for_each(|x| file.write_all(&x.to_le_bytes()))?;
        file.write_all(b"data")?;
        file.write_all(&bytes.to_le_bytes())?;

        let noise = self.noise_amplitude(samples);
        let key = split_mix(split_mix(self.sound.seed ^ 0x6869_7373) ^ self.camera as u64);
        for number in 0..samples {
            let hiss = if noise > 0.0 { noise * normal(key.wrapping_add(number as u64)) } else { 0.0 };
            let value = ((self.sample(number) + hiss).clamp(-1.0, 1.0) * 32767.0).round() as i16;
            file.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    }

    /// Root mean square of the noise: the root mean square of the sound over the recording, less the decibels.
    fn noise_amplitude(&self, samples: usize) -> f64 {
        let Some(noise_db) = self.noise_db else { return 0.0 };
        // Every 7th sample estimates the power well enough.
        let (sum, count) = (0..samples)
            .step_by(7)
            .fold((0.0, 0.0), |(sum, count), i| (sum + self.sample(i).powi(2), count + 1.0));
        (sum / count).sqrt() * libm::pow(10.0, -noise_db / 20.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::{Perturbations, RigSettings};
    use super::super::view::Rig;
    use super::*;

    fn rig(perturbations: Perturbations) -> Rig {
        Rig::new(&RigSettings {
            cameras: 3,
            seconds: 1.0,
            fps: 30.0,
            size: [16, 16],
            seed: 9,
            crf: 12,
            shadow: false,
            masks: false,
            perturbations,
        })
        .unwrap()
    }

    #[test]
    fn the_sound_is_in_its_band_and_interpolates_smoothly() {
        let sound = Sound::at([0.0; 3], 3);
        let values: Vec<f64> = (0..24_000).map(|i| sound.noise(f64::from(i) / 48_000.0)).collect();
        let power = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64;
        assert!((power(&values) - 0.75).abs() < 0.1, "{}", power(&values));
        // Of a tone in the band and one outside, by Goertzel's sums over half a second.
        let tone = |hertz: f64| {
            let sums = values.iter().enumerate().fold([0.0; 2], |[a, b], (i, x)| {
                let (sin, cos) = libm::sincos(2.0 * PI * hertz * i as f64 / 48_000.0);
                [a + x * cos, b + x * sin]
            });
            sums[0] * sums[0] + sums[1] * sums[1]
        };
        let mean = |hertz: [f64; 2]| {
            (0..40).map(|i| tone(hertz[0] + (hertz[1] - hertz[0]) * f64::from(i) / 40.0)).sum::<f64>()
        };
        assert!(mean([1000.0, 4000.0]) > 1000.0 * mean([7000.0, 12_000.0]));
        assert!(mean([1000.0, 4000.0]) > 10.0 * mean([10.0, 90.0]));
    }

    #[test]
    fn speech_has_syllables_and_pauses_and_the_clap_is_loudest() {
        let sound = Sound::at([0.0; 3], 3);
        let envelope: Vec<f64> = (0..2000).map(|i| sound.speech(f64::from(i) * 0.01)).collect();
        let fraction = |is: &dyn Fn(f64) -> bool| envelope.iter().filter(|x| is(**x)).count() as f64 / 2000.0;
        assert!((0.1..0.5).contains(&fraction(&|x| x == 0.0)), "{}", fraction(&|x| x == 0.0));
        assert!(fraction(&|x| x > 0.4) > 0.25 && fraction(&|x| x > 1.6) == 0.0);
        let loudest = (0..96_000).map(|i| f64::from(i) / 48_000.0);
        let loudest = loudest.max_by(|a, b| sound.value(*a).abs().total_cmp(&sound.value(*b).abs()));
        assert!((0.4..0.41).contains(&loudest.unwrap()), "{loudest:?}");
    }

    #[test]
    fn microphones_hear_one_sound_late_skewed_and_noisy() {
        let rig = rig(Perturbations::ALL);
        let sound = &rig.sound;
        let microphone = |camera: usize, noise_db: Option<f64>| Microphone {
            sound,
            errors: &rig.errors[camera],
            delay_s: sound.delay_s(rig.cameras[camera].position()),
            noise_db,
            camera,
        };
        let record = |camera: usize, noise_db: Option<f64>| {
            let mut wav = Vec::new();
            microphone(camera, noise_db).write_wav(24_000, &mut wav).unwrap();
            assert_eq!(wav.len(), 44 + 48_000);
            let values =
                wav[44..].chunks_exact(2).map(|pair| f64::from(i16::from_le_bytes([pair[0], pair[1]])));
            values.collect::<Vec<f64>>()
        };
        let (clean, noisy) = (record(0, None), record(0, Some(10.0)));
        let power = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
        let noise: Vec<f64> = clean.iter().zip(&noisy).map(|(a, b)| a - b).collect();
        let decibels = 10.0 * (power(&clean) / power(&noise)).log10();
        assert!((decibels - 10.0).abs() < 0.5, "{decibels}");
        // What is at the sound's place at 0.4 s is in the file later.
        for camera in 0..3 {
            let microphone = microphone(camera, None);
            let drift = 1.0 + 1e-6 * microphone.errors.drift_ppm;
            let recorded_s = (0.4 + microphone.delay_s - microphone.errors.start_s) / drift
                + microphone.errors.sound_skew_s;
            let number = (recorded_s * 48_000.0).ceil() as usize;
            let loudness = |numbers: std::ops::Range<usize>| {
                numbers.map(|i| microphone.sample(i).abs()).fold(0.0, f64::max)
            };
            assert!(loudness(number..number + 300) > 3.0 * loudness(number - 300..number));
        }
        let distance_m = of_distance(&rig, 0);
        assert!((microphone(0, None).delay_s * 343.0 - distance_m).abs() < 1e-9);
    }

    fn of_distance(rig: &Rig, camera: usize) -> f64 {
        let (a, b) = (rig.cameras[camera].position(), rig.sound.place);
        (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
    }
}
