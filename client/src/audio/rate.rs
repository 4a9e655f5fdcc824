//! [`RateConverter`]: from the rate of a track to the different rate of a device.

use audio_buffers::direct::InterleavedSlice;
use codec::SOUND_RATE_HZ;
use rubato::audioadapter_buffers as audio_buffers;
use rubato::{Async, FixedAsync, Resampler, SincInterpolationParameters};

use super::packets::Frame;

/// Frames that are converted at a time.
pub(super) const CHUNK: usize = 480;

/// Converts blocks of [`CHUNK`] frames.
pub(super) struct RateConverter {
    resampler: Async<f32>,
    input: Vec<f32>,
    output: Vec<f32>,
    /// Frames of the output that lie before the first frame of the input.
    late: usize,
}

impl RateConverter {
    /// A converter to `rate_hz`; `None` if that is the rate of tracks, or no rate.
    pub(super) fn new(rate_hz: u32) -> Option<RateConverter> {
        if rate_hz == SOUND_RATE_HZ {
            return None;
        }
        let ratio = f64::from(rate_hz) / f64::from(SOUND_RATE_HZ);
        let parameters = SincInterpolationParameters::default();
        let resampler = Async::new_sinc(ratio, 1.0, &parameters, CHUNK, 2, FixedAsync::Input).ok()?;
        let output = vec![0.0; 2 * resampler.output_frames_max()];
        let late = resampler.output_delay();
        Some(RateConverter { resampler, input: vec![0.0; 2 * CHUNK], output, late })
    }

    /// Forgets what was converted: the next frame is the first of another run.
    pub(super) fn restart(&mut self) {
        self.resampler.reset();
        self.late = self.resampler.output_delay();
    }

    /// Converts [`CHUNK`] frames and passes the result to `frame`.
    pub(super) fn convert(&mut self, frames: &[Frame], mut frame: impl FnMut(Frame)) {
        for (samples, frame) in self.input.chunks_exact_mut(2).zip(frames) {
            samples.copy_from_slice(frame);
        }
        let room = self.output.len() / 2;
        let Ok(input) = InterleavedSlice::new(&self.input, 2, CHUNK) else { return };
        let Ok(mut output) = InterleavedSlice::new_mut(&mut self.output, 2, room) else { return };
        let Ok((_, written)) = self.resampler.process_into_buffer(&input, &mut output, None) else { return };
        let late = self.late.min(written);
        self.late -= late;
        for samples in self.output.chunks_exact(2).take(written).skip(late) {
            frame([samples[0], samples[1]]);
        }
    }
}

#[cfg(test)]
mod rate_tests {
    use super::*;

    #[test]
    fn a_tone_arrives_at_its_time_at_other_rates() {
        assert!(RateConverter::new(48_000).is_none() && RateConverter::new(0).is_none());
        for rate_hz in [8_000u32, 44_100, 96_000, 192_000] {
            let mut converter = RateConverter::new(rate_hz).unwrap();
            for run in 0..2 {
                converter.restart();
                let mut converted = Vec::new();
                let tone =
                    |i: usize, rate: u32| (i as f32 / rate as f32 * 440.0 * std::f32::consts::TAU).sin();
                for block in 0..100 {
                    let frames: Vec<Frame> =
                        (0..CHUNK).map(|i| [tone(block * CHUNK + i, 48_000); 2]).collect();
                    converter.convert(&frames, |frame| converted.push(frame));
                }
                let expected = rate_hz as usize;
                assert!(
                    converted.len() > expected - expected / 20 && converted.len() <= expected,
                    "{}",
                    converted.len()
                );
                // The delay is known to one sample of the device.
                let most = 440.0 / rate_hz as f32 * std::f32::consts::TAU + 0.01;
                // Behind the beginning, where the filter has only a half.
                for (i, frame) in converted.iter().enumerate().take(expected / 2).skip(expected / 20) {
                    let error = (frame[0] - tone(i, rate_hz)).abs();
                    assert!(error < most, "{rate_hz} Hz, run {run}, sample {i}: off by {error}");
                }
            }
        }
    }
}
