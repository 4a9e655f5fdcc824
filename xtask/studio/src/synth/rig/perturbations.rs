//! [`CameraErrors`]: what perturbs a camera and its microphone, drawn from the seed.

use super::draws::{Draw, draw};
use super::settings::RigSettings;
use super::timing::Timing;

/// The cameras that stand on their side and that have a variable rate.
const ROTATED: usize = 1;
const VARIABLE: usize = 2;

/// The last camera stops up to this fraction of the range of starts after second [`RigSettings::seconds`].
const LATE_END: f64 = 0.25;

/// What perturbs a camera and its microphone.
#[derive(Clone, Debug)]
pub(super) struct CameraErrors {
    /// Time of the first frame, in seconds; at most 0, when the last camera starts.
    pub(super) start_s: f64,
    /// Seconds that pass while the camera counts one, less 1, in millionths.
    pub(super) drift_ppm: f64,
    /// Presentation times by the camera.
    pub(super) timing: Timing,
    /// Number of frames.
    pub(super) frames: usize,
    /// Factors of red, green and blue, as displayed.
    pub(super) gains: [f64; 3],
    /// Standard deviation of a pixel's noise, in 255ths.
    pub(super) noise: f64,
    /// Seconds by which the sound is later in the file than the pictures.
    pub(super) sound_skew_s: f64,
    /// Whether the camera stands on its side.
    pub(super) is_rotated: bool,
}

impl CameraErrors {
    /// Time at which the camera shows `presented_s` seconds since its first frame.
    pub(super) fn time_s(&self, presented_s: f64) -> f64 {
        self.start_s + presented_s * (1.0 + 1e-6 * self.drift_ppm)
    }

    /// Time of a frame.
    pub(super) fn frame_time_s(&self, frame: usize) -> f64 {
        self.time_s(self.timing.seconds(frame))
    }
}

/// What perturbs each camera of a rig.
pub(super) fn camera_errors(settings: &RigSettings) -> Vec<CameraErrors> {
    let RigSettings { cameras, seconds, fps, seed, perturbations: sizes, .. } = *settings;
    let start_s = |camera: usize| {
        let start_s = sizes.starts_s * 0.5 * draw(seed, camera, Draw::Start);
        if sizes.offsets { start_s } else { (start_s * fps).round() / fps }
    };
    let last_s = (0..cameras).map(start_s).fold(f64::NEG_INFINITY, f64::max);
    let errors = |camera: usize| {
        let drawn = |quantity: Draw, size: f64| size * draw(seed, camera, quantity);
        let exposure = 1.0 + drawn(Draw::Exposure, sizes.exposure);
        let [red, blue] = [Draw::Red, Draw::Blue].map(|color| 1.0 + drawn(color, sizes.white_balance));
        let millifps = settings.millifps();
        let mut errors = CameraErrors {
            start_s: start_s(camera) - last_s,
            drift_ppm: drawn(Draw::Drift, sizes.drift_ppm),
            timing: match sizes.variable_rate && camera == VARIABLE {
                true => Timing::variable(millifps, seed, camera),
                false => Timing::Constant { millifps },
            },
            frames: 0,
            gains: [exposure * red, exposure, exposure * blue],
            noise: sizes.noise,
            sound_skew_s: drawn(Draw::Skew, sizes.sound_skew_s),
            is_rotated: sizes.rotated && camera == ROTATED,
        };
        let end_s = seconds + LATE_END * sizes.starts_s * (0.5 + drawn(Draw::End, 0.5));
        // At least until then: the first frame that is as late, but for rounding.
        let is_before = |frame: &usize| errors.frame_time_s(*frame) < end_s - 1e-9;
        errors.frames = (0..).take_while(is_before).count() + 1;
        errors
    };
    (0..cameras).map(errors).collect()
}

#[cfg(test)]
mod tests {
    use super::super::settings::Perturbations;
    use super::*;

    fn settings(perturbations: Perturbations) -> RigSettings {
        RigSettings {
            cameras: 40,
            seconds: 3.0,
            fps: 25.0,
            size: [64, 48],
            seed: 5,
            crf: 12,
            shadow: false,
            masks: false,
            perturbations,
        }
    }

    #[test]
    fn errors_fill_their_ranges() {
        let errors = camera_errors(&settings(Perturbations::ALL));
        let range = |value: &dyn Fn(&CameraErrors) -> f64| {
            let values: Vec<f64> = errors.iter().map(value).collect();
            [
                values.iter().copied().fold(f64::INFINITY, f64::min),
                values.iter().copied().fold(f64::MIN, f64::max),
            ]
        };
        let fills = |[low, high]: [f64; 2], [least, most]: [f64; 2]| {
            let margin = 0.15 * (most - least);
            assert!(low >= least && low < least + margin, "{low} of {least}");
            assert!(high <= most && high > most - margin, "{high} of {most}");
        };
        fills(range(&|e| e.start_s), [-2.0, 0.0]);
        assert_eq!(range(&|e| e.start_s)[1], 0.0);
        fills(range(&|e| e.drift_ppm), [-20.0, 20.0]);
        fills(range(&|e| e.gains[1]), [0.8, 1.2]);
        fills(range(&|e| e.gains[0] / e.gains[1]), [0.9, 1.1]);
        fills(range(&|e| e.gains[2] / e.gains[1]), [0.9, 1.1]);
        fills(range(&|e| e.sound_skew_s), [-0.04, 0.04]);
        fills(range(&|e| (e.start_s * 25.0).rem_euclid(1.0)), [0.0, 1.0]);
        fills(range(&|e| e.frame_time_s(e.frames - 1)), [3.0, 3.5 + 0.1]);
        assert_eq!(errors.iter().filter(|e| e.is_rotated).count(), 1);
        assert_eq!(errors.iter().filter(|e| matches!(e.timing, Timing::Variable { .. })).count(), 1);
    }

    #[test]
    fn without_perturbations_all_cameras_are_alike() {
        for errors in camera_errors(&settings(Perturbations::NONE)) {
            assert_eq!((errors.start_s, errors.frames), (0.0, 76));
            assert_eq!((errors.frame_time_s(75), errors.gains, errors.noise), (3.0, [1.0; 3], 0.0));
            assert!(errors.sound_skew_s == 0.0 && !errors.is_rotated);
        }
    }

    #[test]
    fn one_perturbation_does_not_change_the_others() {
        let all = camera_errors(&settings(Perturbations::ALL));
        let fewer = camera_errors(&settings(Perturbations {
            exposure: 0.0,
            offsets: false,
            variable_rate: false,
            ..Perturbations::ALL
        }));
        for (all, fewer) in all.iter().zip(&fewer) {
            assert_eq!((all.drift_ppm, all.sound_skew_s), (fewer.drift_ppm, fewer.sound_skew_s));
            assert!((all.gains[0] / all.gains[1] - fewer.gains[0]).abs() < 1e-12 && fewer.gains[1] == 1.0);
            assert!((all.start_s - fewer.start_s).abs() <= 0.04 + 1e-9);
            assert!((fewer.start_s * 25.0 - (fewer.start_s * 25.0).round()).abs() < 1e-9, "whole frames");
        }
        let other = camera_errors(&RigSettings { seed: 6, ..settings(Perturbations::ALL) });
        assert_ne!(all[0].drift_ppm, other[0].drift_ppm);
    }
}
