//! [`LearningRates`]: the step length of each column, and [`decay`], their schedule.

use codec::sh_coefficients;

use serde::{Deserialize, Serialize};

use crate::fit::parameters::{COLUMNS, Parameters};
use crate::fit::precision::Real;

/// Fraction of the steps, at the end, over which the rates decay.
const DECAY_SHARE: f64 = 0.1;

/// Factor of the rates at the end.
const DECAY_TO: f64 = 0.01;

/// Learning rates of Adam by column.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::fit) struct LearningRates {
    /// For the centres, in units of the capture.
    pub(in crate::fit) centers: f64,
    /// For the quaternions.
    pub(in crate::fit) rotations: f64,
    /// For the logarithms of the scales.
    pub(in crate::fit) log_scales: f64,
    /// For the logits of the opacities.
    pub(in crate::fit) logits: f64,
    /// For the spherical harmonics coefficient of degree 0.
    pub(in crate::fit) sh_first: f64,
    /// For the coefficients of degrees 1 to 3.
    pub(in crate::fit) sh_rest: f64,
    /// For the window centres, in frames.
    pub(in crate::fit) tau: f64,
    /// For the logarithms of the window widths.
    pub(in crate::fit) log_widths: f64,
    /// For `c1, c2, c3`, in units of the capture.
    pub(in crate::fit) motion: [f64; 3],
    /// For the rates of the quaternions per frame.
    pub(in crate::fit) rotation_rates: f64,
}

impl LearningRates {
    /// The rates for a scene of `extent`, in units of the capture.
    ///
    /// The columns of a static field have the rates of 3D Gaussian Splatting and gsplat. `c1` is the
    /// distance that a Gaussian moves within a frame and has the rate of the centres; `c2` and `c3`
    /// have a half and a quarter of it, because they grow with the square and cube of the frames.
    /// `tau` has the rate of Spacetime Gaussians for clips of 50 frames.
    pub(in crate::fit) fn new(extent: f64) -> LearningRates {
        let centers = 1.6e-4 * extent;
        LearningRates {
            centers,
            rotations: 1e-3,
            log_scales: 5e-3,
            logits: 5e-2,
            sh_first: 2.5e-3,
            sh_rest: 2.5e-3 / 20.0,
            tau: 5e-3,
            log_widths: 5e-3,
            motion: [centers, centers / 2.0, centers / 4.0],
            rotation_rates: 1e-3,
        }
    }

    /// The rates times `factor`.
    pub(in crate::fit) fn scaled(&self, factor: f64) -> LearningRates {
        LearningRates {
            centers: self.centers * factor,
            rotations: self.rotations * factor,
            log_scales: self.log_scales * factor,
            logits: self.logits * factor,
            sh_first: self.sh_first * factor,
            sh_rest: self.sh_rest * factor,
            tau: self.tau * factor,
            log_widths: self.log_widths * factor,
            motion: self.motion.map(|rate| rate * factor),
            rotation_rates: self.rotation_rates * factor,
        }
    }

    /// The rate of each number of a row, by column.
    pub(in crate::fit) fn by_column<T: Real>(&self, parameters: &Parameters<T>) -> [Vec<T>; COLUMNS] {
        let sh = |i: usize| T::from_f64(if i < 3 { self.sh_first } else { self.sh_rest });
        let motion = &self.motion[..usize::from(parameters.motion_order)];
        [
            vec![T::from_f64(self.centers); 3],
            vec![T::from_f64(self.rotations); 4],
            vec![T::from_f64(self.log_scales); 3],
            vec![T::from_f64(self.logits)],
            (0..3 * sh_coefficients(parameters.sh_degree)).map(sh).collect(),
            vec![T::from_f64(self.tau)],
            vec![T::from_f64(self.log_widths)],
            motion.iter().flat_map(|rate| [T::from_f64(*rate); 3]).collect(),
            vec![T::from_f64(self.rotation_rates); 4],
        ]
    }
}

/// Factor of the rates at `step` (from 0) of `steps`: 1 for the first nine tenths, then exponential
/// decay to 0.01 (the paper's section on implementation).
pub(in crate::fit) fn decay(step: usize, steps: usize) -> f64 {
    let done = step as f64 / steps.max(1) as f64;
    let within = ((done - (1.0 - DECAY_SHARE)) / DECAY_SHARE).clamp(0.0, 1.0);
    libm::pow(DECAY_TO, within)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rates_decay_over_the_last_tenth() {
        assert_eq!([0, 1, 500, 899, 900].map(|step| decay(step, 1000)), [1.0; 5]);
        for (step, expected) in [(950, 0.1), (925, 0.1_f64.sqrt()), (1000, 0.01), (2000, 0.01)] {
            assert!((decay(step, 1000) - expected).abs() < 1e-12, "{step}");
        }
        assert_eq!((decay(0, 0), decay(0, 1)), (1.0, 1.0));
    }

    #[test]
    fn every_number_of_a_row_has_a_rate() {
        let parameters = Parameters::<f64> {
            centers: vec![[0.0; 3]],
            sh_degree: 2,
            motion_order: 2,
            ..Parameters::default()
        };
        let rates = LearningRates::new(2.0).scaled(0.5).by_column(&parameters);
        assert_eq!(rates[0], [1.6e-4; 3]);
        assert_eq!(rates[4].len(), 27);
        assert_eq!((rates[4][2], rates[4][3]), (1.25e-3, 6.25e-5));
        assert_eq!(rates[7], [1.6e-4, 1.6e-4, 1.6e-4, 0.8e-4, 0.8e-4, 0.8e-4]);
    }
}
