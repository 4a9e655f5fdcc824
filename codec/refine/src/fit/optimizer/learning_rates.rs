//! [`LearningRates`]: the step length of each column, and [`decay`], their schedule.
//!
//! The rates of 3D Gaussian Splatting are made for 30,000 steps, each with most Gaussians visible. In a
//! fit over time a photograph shows the Gaussians of a few frames only, so each of them moves in a fraction of the
//! steps, and colours and sizes arrive at those rates too late. The rates here were swept on captures with and
//! without time: on stage-knight (16 cameras at 128x96, 6000 steps) held frames have 24.8 dB at the rates of 3D
//! Gaussian Splatting, and 28.3 dB at these rates with motion 5/3 as fast. The optimum is flat except for motion: too
//! slow, it does not follow; too fast, held frames lose.

use codec::sh_coefficients;

use serde::{Deserialize, Serialize};

use crate::fit::parameters::{COLUMNS, Carried, Parameters, STATIC_SHARE};
use crate::median::median;
use crate::raster::Real;

/// For the centres, in extents of the scene: 3 times the rate of 3D Gaussian Splatting.
const CENTERS: f64 = 4.8e-4;

/// For the quaternions: 6 times the rate of 3D Gaussian Splatting.
const ROTATIONS: f64 = 6e-3;

/// For the logarithms of the scales: 6 times the rate of 3D Gaussian Splatting.
const LOG_SCALES: f64 = 3e-2;

/// For the logits of the opacities, as in 3D Gaussian Splatting.
const LOGITS: f64 = 5e-2;

/// For the spherical harmonics coefficient of degree 0: 10 times the rate of 3D Gaussian Splatting.
const SH_FIRST: f64 = 2.5e-2;

/// For the coefficients of degrees 1 to 3: 40 times the rate of 3D Gaussian Splatting, which is a 20th of its rate
/// for degree 0.
const SH_REST: f64 = 5e-3;

/// For the window centres, in intervals: the rate of Spacetime Gaussians for clips of 50 frames.
const TAU: f64 = 2.5e-3;

/// For the logarithms of the window widths.
const LOG_WIDTHS: f64 = 5e-3;

/// For the rates of the quaternions per interval.
const ROTATION_RATES: f64 = 1e-3;

/// Distance from its centre, in widths, up to which a window's opacity matters: it is 1/90 of the peak there.
const SUPPORT_RADIUS: f64 = 3.0;

/// Fraction of the steps, at the end, over which the rates decay. The paper's is 0.1, of 96,000 steps. Swept for fits
/// of 6000 steps and refinements of 2000: at 0.2, 0.4 and 0.5, held frames of stage-knight have 30.36, 30.41 and 30.33
/// dB after a fit, and 29.82, 30.32 and 30.42 dB after a refinement.
const DECAY_SHARE: f64 = 0.4;

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
    /// For the window centres, in intervals.
    pub(in crate::fit) tau: f64,
    /// For the logarithms of the window widths.
    pub(in crate::fit) log_widths: f64,
    /// For `c1, c2, c3`, in units of the capture.
    pub(in crate::fit) motion: [f64; 3],
    /// For the rates of the quaternions per interval.
    pub(in crate::fit) rotation_rates: f64,
}

impl LearningRates {
    /// The rates for `parameters` in a scene of `extent`, in units of the capture.
    ///
    /// At the edge of the median window, a step of any motion coefficient moves a Gaussian as far as a step of its
    /// centre does. Without that division by powers of the support radius, a step of `c3` would throw it many times as
    /// far.
    ///
    /// The rates of a static field, which has no window centres, are 0.4 times as high.
    pub(in crate::fit) fn new<T: Real>(extent: f64, parameters: &Parameters<T>) -> LearningRates {
        LearningRates::carrying(extent, parameters, &[])
    }

    /// Those of a field that moves, from the logarithms of the widths of its windows.
    fn of_widths(extent: f64, log_widths: impl Iterator<Item = f64>) -> LearningRates {
        let widths: Vec<f64> = log_widths.map(libm::exp).collect();
        let support_radius = SUPPORT_RADIUS * median(widths).unwrap_or(1.0);
        let centers = CENTERS * extent;
        LearningRates {
            centers,
            rotations: ROTATIONS,
            log_scales: LOG_SCALES,
            logits: LOGITS,
            sh_first: SH_FIRST,
            sh_rest: SH_REST,
            tau: TAU,
            log_widths: LOG_WIDTHS,
            motion: [1, 2, 3].map(|power| centers * support_radius.powi(-power)),
            rotation_rates: ROTATION_RATES,
        }
    }

    /// The rates of a fit whose rows have this past, or none: what stands still or is finished is moved by no rate of time.
    pub(in crate::fit) fn carrying<T: Real>(
        extent: f64,
        parameters: &Parameters<T>,
        carried: &[Carried],
    ) -> LearningRates {
        let moves = |row: usize| carried.get(row).is_none_or(|carried| carried.share_of_time() > 0.0);
        let widths = parameters.log_widths.iter().enumerate().filter(|(row, _)| moves(*row));
        let rates = LearningRates::of_widths(extent, widths.map(|(_, width)| width.to_double()));
        if parameters.tau.is_empty() { rates.scaled(STATIC_SHARE.into()) } else { rates }
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

/// Factor of the rates at `step` (from 0) of `steps`: 1 for the first three fifths, then exponential decay to 0.01
/// (the paper's section on implementation).
pub(in crate::fit) fn decay(step: usize, steps: usize) -> f64 {
    let done = step as f64 / steps.max(1) as f64;
    let within = ((done - (1.0 - DECAY_SHARE)) / DECAY_SHARE).clamp(0.0, 1.0);
    libm::pow(DECAY_TO, within)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rates_decay_over_the_last_two_fifths() {
        assert_eq!([0, 1, 300, 599, 600].map(|step| decay(step, 1000)), [1.0; 5]);
        for (step, expected) in [(800, 0.1), (700, 0.1_f64.sqrt()), (1000, 0.01), (2000, 0.01)] {
            assert!((decay(step, 1000) - expected).abs() < 1e-12, "{step}");
        }
        assert_eq!((decay(0, 0), decay(0, 1)), (1.0, 1.0));
    }

    #[test]
    fn every_number_of_a_row_has_a_rate() {
        let parameters = Parameters::<f64> {
            centers: vec![[0.0; 3]],
            sh_degree: 2,
            tau: vec![0.0],
            motion_order: 2,
            ..Parameters::default()
        };
        let rates = LearningRates::new(2.0, &parameters);
        let columns = rates.scaled(0.5).by_column(&parameters);
        assert_eq!(columns[0], [CENTERS; 3]);
        assert_eq!(columns[4].len(), 27);
        assert_eq!((columns[4][2], columns[4][3]), (0.5 * SH_FIRST, 0.5 * SH_REST));
        let [c1, c2, _] = rates.motion.map(|rate| 0.5 * rate);
        assert_eq!(columns[7], [c1, c1, c1, c2, c2, c2]);
    }

    /// Also where rows have a past, as those that are refined before a plate.
    #[test]
    fn a_static_field_has_its_rates_whatever_its_rows_carry() {
        let fixed = Parameters::<f64> { centers: vec![[0.0; 3]], ..Parameters::default() };
        let expected = LearningRates::new(2.0, &fixed);
        assert_eq!(LearningRates::carrying(2.0, &fixed, &[Carried::NONE]), expected);
    }

    /// The edge of the median window is 3 widths of 2 intervals from its centre.
    #[test]
    fn motion_moves_a_gaussian_as_far_as_its_centre() {
        let log_widths = [0.5, 2.0, 8.0].map(f64::ln).to_vec();
        let parameters = Parameters { tau: vec![0.0; 3], log_widths, ..Parameters::default() };
        let LearningRates { centers, motion: [c1, c2, c3], .. } = LearningRates::new(10.0, &parameters);
        for step in [c1 * 6.0, c2 * 36.0, c3 * 216.0] {
            assert!((step - centers).abs() < 1e-12, "{step}");
        }
    }

    #[test]
    fn rates_of_a_static_field_are_lower() {
        let timed = Parameters::<f64> { tau: vec![0.0], log_widths: vec![0.0], ..Parameters::default() };
        let fixed = LearningRates::new(2.0, &Parameters::<f64>::default());
        let rates = LearningRates::new(2.0, &timed);
        let share = f64::from(STATIC_SHARE);
        assert_eq!((rates.centers, fixed.centers), (2.0 * CENTERS, share * (2.0 * CENTERS)));
        assert_eq!((fixed.logits, fixed.sh_rest), (share * LOGITS, share * SH_REST));
    }
}
