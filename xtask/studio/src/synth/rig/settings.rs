//! [`RigSettings`]: the size of a rig and what perturbs it.

use std::ops::RangeInclusive;

use program::Fault;
use serde::Serialize;

use crate::synth::stage::StageSettings;

/// Size of a rig and of its videos.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RigSettings {
    /// Number of cameras, 1 to 256.
    pub cameras: usize,
    /// Seconds in which all cameras run, from second 0 on; 1 to 3000.
    pub seconds: f64,
    /// Frames per second, 1 to 240, with at most three decimals.
    pub fps: f64,
    /// Width and height of the upright pictures in pixels; even, 16 to 2048.
    pub size: [u32; 2],
    /// Seed of everything drawn.
    pub seed: u64,
    /// Quality of the videos: x264's constant rate factor, 0 (none lost) to 51.
    pub crf: u8,
    /// Whether the figure casts a shadow on the floor, so that the background is not static.
    pub shadow: bool,
    /// Whether masks and plates are written.
    pub masks: bool,
    /// What differs from a synchronous rig of equal cameras.
    pub perturbations: Perturbations,
}

/// Sizes of the errors of cameras and microphones. Ranges are symmetric: `0.2` is from -0.2 to 0.2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Perturbations {
    /// Seconds between the first and the last camera that starts, at most; 0 to 10.
    pub starts_s: f64,
    /// Whether frames of different cameras are offset by fractions of a frame.
    pub offsets: bool,
    /// Largest error of a camera's rate, in parts per million; 0 to 1000.
    pub drift_ppm: f64,
    /// Largest relative error of exposure, 0 to 0.9.
    pub exposure: f64,
    /// Largest relative error of red and blue, 0 to 0.9.
    pub white_balance: f64,
    /// Standard deviation of a pixel's noise, in 255ths; 0 to 50.
    pub noise: f64,
    /// Largest time by which sound is recorded late or early, in seconds; 0 to 0.5.
    pub sound_skew_s: f64,
    /// Power of the sound relative to the noise of a microphone, in decibels; -20 to 100. `None`: no noise.
    pub sound_noise_db: Option<f64>,
    /// Whether the second camera stands on its side.
    pub rotated: bool,
    /// Whether the third camera has a variable frame rate.
    pub variable_rate: bool,
}

impl Perturbations {
    /// A synchronous rig of equal cameras.
    pub const NONE: Perturbations = Perturbations {
        starts_s: 0.0,
        offsets: false,
        drift_ppm: 0.0,
        exposure: 0.0,
        white_balance: 0.0,
        noise: 0.0,
        sound_skew_s: 0.0,
        sound_noise_db: None,
        rotated: false,
        variable_rate: false,
    };

    /// The default sizes of all.
    pub const ALL: Perturbations = Perturbations {
        starts_s: 2.0,
        offsets: true,
        drift_ppm: 20.0,
        exposure: 0.2,
        white_balance: 0.1,
        noise: 2.0,
        sound_skew_s: 0.04,
        sound_noise_db: Some(10.0),
        rotated: true,
        variable_rate: true,
    };
}

/// Permitted values.
const SECONDS: RangeInclusive<f64> = 1.0..=3000.0;
const FPS: RangeInclusive<f64> = 1.0..=240.0;
const SIDE_MIN: u32 = 16;
const CRF_MAX: u8 = 51;
pub(super) const STARTS_MAX_S: f64 = 10.0;
const DRIFT_MAX_PPM: f64 = 1000.0;
const COLOR_MAX: f64 = 0.9;
const NOISE_MAX: f64 = 50.0;
const SKEW_MAX_S: f64 = 0.5;
const SOUND_NOISE_DB: RangeInclusive<f64> = -20.0..=100.0;

impl RigSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Fault::Usage`] that names the value out of range.
    pub fn check(&self) -> Result<(), Fault> {
        self.stage().check()?;
        let RigSettings { seconds, fps, size: [width, height], crf, .. } = *self;
        if width % 2 != 0 || height % 2 != 0 || width.min(height) < SIDE_MIN {
            return Err(Fault::Usage(format!(
                "{width}x{height} pixels: videos have even sides, from {SIDE_MIN} on"
            )));
        }
        within("seconds", seconds, &SECONDS)?;
        within("fps", fps, &FPS)?;
        if (fps - self.millifps() as f64 / 1000.0).abs() > 1e-9 {
            return Err(Fault::Usage(format!("fps {fps}: use at most three decimals")));
        }
        if crf > CRF_MAX {
            return Err(Fault::Usage(format!("crf {crf}: use 0 to {CRF_MAX}")));
        }
        self.perturbations.check()
    }

    /// The stage with these cameras.
    pub(super) fn stage(&self) -> StageSettings {
        StageSettings { cameras: self.cameras, frames: 1, size: self.size, props: false }
    }

    /// Frames in 1000 seconds, a whole number.
    pub(super) fn millifps(&self) -> u32 {
        (self.fps * 1000.0).round() as u32
    }
}

impl Perturbations {
    fn check(&self) -> Result<(), Fault> {
        within("starts", self.starts_s, &(0.0..=STARTS_MAX_S))?;
        within("drift", self.drift_ppm, &(0.0..=DRIFT_MAX_PPM))?;
        within("exposure", self.exposure, &(0.0..=COLOR_MAX))?;
        within("white balance", self.white_balance, &(0.0..=COLOR_MAX))?;
        within("noise", self.noise, &(0.0..=NOISE_MAX))?;
        within("sound skew", self.sound_skew_s, &(0.0..=SKEW_MAX_S))?;
        self.sound_noise_db.map_or(Ok(()), |noise_db| within("sound noise", noise_db, &SOUND_NOISE_DB))
    }
}

fn within(name: &str, value: f64, range: &RangeInclusive<f64>) -> Result<(), Fault> {
    match range.contains(&value) {
        true => Ok(()),
        false => Err(Fault::Usage(format!("{name} {value}: use {} to {}", range.start(), range.end()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_refused() {
        let settings = RigSettings {
            cameras: 2,
            seconds: 1.0,
            fps: 29.97,
            size: [64, 48],
            seed: 0,
            crf: 12,
            shadow: false,
            masks: false,
            perturbations: Perturbations::ALL,
        };
        settings.check().unwrap();
        let refused = |change: &dyn Fn(&mut RigSettings)| {
            let mut wrong = settings;
            change(&mut wrong);
            let fault = wrong.check().unwrap_err();
            assert_eq!(fault.exit_code(), 2);
            fault.to_string()
        };
        assert_eq!(refused(&|s| s.cameras = 0), "0 cameras: use 1 to 256");
        assert_eq!(refused(&|s| s.size = [63, 48]), "63x48 pixels: videos have even sides, from 16 on");
        assert_eq!(refused(&|s| s.size = [64, 14]), "64x14 pixels: videos have even sides, from 16 on");
        assert_eq!(refused(&|s| s.seconds = f64::NAN), "seconds NaN: use 1 to 3000");
        assert_eq!(refused(&|s| s.fps = 0.5), "fps 0.5: use 1 to 240");
        assert_eq!(refused(&|s| s.fps = 29.970_03), "fps 29.97003: use at most three decimals");
        assert_eq!(refused(&|s| s.crf = 52), "crf 52: use 0 to 51");
        assert_eq!(refused(&|s| s.perturbations.starts_s = 11.0), "starts 11: use 0 to 10");
        assert_eq!(refused(&|s| s.perturbations.drift_ppm = -1.0), "drift -1: use 0 to 1000");
        assert_eq!(refused(&|s| s.perturbations.exposure = 1.0), "exposure 1: use 0 to 0.9");
        assert_eq!(refused(&|s| s.perturbations.white_balance = 1.0), "white balance 1: use 0 to 0.9");
        assert_eq!(refused(&|s| s.perturbations.noise = 51.0), "noise 51: use 0 to 50");
        assert_eq!(refused(&|s| s.perturbations.sound_skew_s = 0.6), "sound skew 0.6: use 0 to 0.5");
        assert_eq!(
            refused(&|s| s.perturbations.sound_noise_db = Some(f64::INFINITY)),
            "sound noise inf: use -20 to 100"
        );
    }
}
