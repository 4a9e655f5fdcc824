//! [`Rates`]: how far Adam moves each column in a step, and [`decay`], how that ends.

use codec::sh_coefficients;

use serde::{Deserialize, Serialize};

use super::columns::COLUMNS;
use super::{Parameters, Real};

/// Share of the steps, at their end, over which the rates decay.
const DECAY_SHARE: f64 = 0.1;

/// What is left of the rates at the end.
const DECAY_TO: f64 = 0.01;

/// Step lengths of Adam by column.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Rates {
    /// Of the centres, in units of the capture.
    pub(super) centers: f64,
    /// Of the quaternions.
    pub(super) rotations: f64,
    /// Of the logarithms of the scales.
    pub(super) log_scales: f64,
    /// Of the logits of the opacities.
    pub(super) logits: f64,
    /// Of the first coefficient of the spherical harmonics.
    pub(super) sh_first: f64,
    /// Of the others.
    pub(super) sh_rest: f64,
    /// Of the window centres, in frames.
    pub(super) tau: f64,
    /// Of the logarithms of the window widths.
    pub(super) log_widths: f64,
    /// Of `c1, c2, c3`, in units of the capture.
    pub(super) motion: [f64; 3],
    /// Of the rates of the quaternions per frame.
    pub(super) rotation_rates: f64,
}

impl Rates {
    /// The rates for a scene of `extent`, the radius within which its cameras stand, in units of
    /// the capture.
    ///
    /// Those of 3D Gaussian Splatting and gsplat for what is there too; a coefficient of motion is
    /// how far a Gaussian goes within a frame and takes the rate of the centres, the higher ones a
    /// half and a quarter of it, as they grow with the square and cube of the frames. `tau` in
    /// frames takes what Spacetime Gaussians give it in clips of 50.
    pub(super) fn new(extent: f64) -> Rates {
        let centers = 1.6e-4 * extent;
        Rates {
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

    /// All of them times `factor`.
    pub(super) fn scaled(&self, factor: f64) -> Rates {
        Rates {
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

    /// The rates of the numbers of a row, by column.
    pub(super) fn by_column<T: Real>(&self, parameters: &Parameters<T>) -> [Vec<T>; COLUMNS] {
        let sh = |i: usize| T::of(if i < 3 { self.sh_first } else { self.sh_rest });
        let motion = &self.motion[..usize::from(parameters.motion_order)];
        [
            vec![T::of(self.centers); 3],
            vec![T::of(self.rotations); 4],
            vec![T::of(self.log_scales); 3],
            vec![T::of(self.logits)],
            (0..3 * sh_coefficients(parameters.sh_degree)).map(sh).collect(),
            vec![T::of(self.tau)],
            vec![T::of(self.log_widths)],
            motion.iter().flat_map(|rate| [T::of(*rate); 3]).collect(),
            vec![T::of(self.rotation_rates); 4],
        ]
    }
}

/// Factor of the rates at `step`, counted from 0, of `steps`: 1 over the first nine tenths, then
/// exponentially down to 0.01 (the paper's section on implementation).
pub(super) fn decay(step: usize, steps: usize) -> f64 {
    let done = step as f64 / steps.max(1) as f64;
    let within = ((done - (1.0 - DECAY_SHARE)) / DECAY_SHARE).clamp(0.0, 1.0);
    libm::pow(DECAY_TO, within)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rates_fall_at_the_end_alone() {
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
        let rates = Rates::new(2.0).scaled(0.5).by_column(&parameters);
        assert_eq!(rates[0], [1.6e-4; 3]);
        assert_eq!(rates[4].len(), 27);
        assert_eq!((rates[4][2], rates[4][3]), (1.25e-3, 6.25e-5));
        assert_eq!(rates[7], [1.6e-4, 1.6e-4, 1.6e-4, 0.8e-4, 0.8e-4, 0.8e-4]);
    }
}
