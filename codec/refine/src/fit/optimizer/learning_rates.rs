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

use crate::fit::parameters::{COLUMNS, Parameters, STATIC_SHARE, Timeline};
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

/// For the window centres, in intervals: 4 times the rate of Spacetime Gaussians for clips of 50 frames, at which windows
/// stay as they start. `codec/refine/MEASURED.md` has what it is worth, with [`LOG_WIDTHS`].
const TAU: f64 = 1e-2;

/// For the logarithms of the window widths.
const LOG_WIDTHS: f64 = 2e-2;

/// For the rates of the quaternions per interval.
const ROTATION_RATES: f64 = 1e-3;

/// Distance from its centre, in widths, up to which a window's opacity matters: it is 1/90 of the peak there.
pub(in crate::fit) const SUPPORT_RADIUS: f64 = 3.0;

/// Shortest time from the centre of a window, in intervals, at which photographs tell how far a Gaussian moved.
pub(in crate::fit) const REACH_MIN: f64 = 1.0;

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
    /// For the rates of the quaternions per interval.
    pub(in crate::fit) rotation_rates: f64,
    /// Longest time from the centre of a window, in intervals, to which motion leads: half the clip.
    pub(in crate::fit) reach_max: f64,
}

impl LearningRates {
    /// The rates for `parameters` over `timeline` in a scene of `extent`, in units of the capture. The rates of a static
    /// field, which has no window centres, are 0.4 times as high.
    pub(in crate::fit) fn new<T: Real>(
        extent: f64,
        timeline: Timeline,
        parameters: &Parameters<T>,
    ) -> LearningRates {
        let rates = LearningRates {
            centers: CENTERS * extent,
            rotations: ROTATIONS,
            log_scales: LOG_SCALES,
            logits: LOGITS,
            sh_first: SH_FIRST,
            sh_rest: SH_REST,
            tau: TAU,
            log_widths: LOG_WIDTHS,
            rotation_rates: ROTATION_RATES,
            reach_max: (0.5 * timeline.intervals).max(REACH_MIN),
        };
        if parameters.tau.is_empty() { rates.scaled(STATIC_SHARE.into()) } else { rates }
    }

    /// The rates of `c1, c2, c3` of a Gaussian whose window has this logarithm of a width, in units of the capture.
    ///
    /// At the edge of its window, or of the clip, a step of any of them moves the Gaussian as far as a step of its centre
    /// does. Where all Gaussians had the rates of one width, a step of `c3` would throw those that stay a hundred times
    /// as far, or those that come and go would hardly learn to move.
    pub(in crate::fit) fn motion(&self, log_width: f64) -> [f64; 3] {
        let reach = (SUPPORT_RADIUS * libm::exp(log_width)).clamp(REACH_MIN, self.reach_max);
        [1, 2, 3].map(|power| self.centers * reach.powi(-power))
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
            rotation_rates: self.rotation_rates * factor,
            reach_max: self.reach_max,
        }
    }

    /// The rate of each number of a row, by column; none for motion, whose rates differ from row to row.
    pub(in crate::fit) fn by_column<T: Real>(&self, parameters: &Parameters<T>) -> [Vec<T>; COLUMNS] {
        let sh = |i: usize| T::from_f64(if i < 3 { self.sh_first } else { self.sh_rest });
        [
            vec![T::from_f64(self.centers); 3],
            vec![T::from_f64(self.rotations); 4],
            vec![T::from_f64(self.log_scales); 3],
            vec![T::from_f64(self.logits)],
            (0..3 * sh_coefficients(parameters.sh_degree)).map(sh).collect(),
            vec![T::from_f64(self.tau)],
            vec![T::from_f64(self.log_widths)],
            Vec::new(),
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
        let rates = LearningRates::new(2.0, Timeline::even(9), &parameters);
        let columns = rates.scaled(0.5).by_column(&parameters);
        assert_eq!(columns[0], [CENTERS; 3]);
        assert_eq!(columns[4].len(), 27);
        assert_eq!((columns[4][2], columns[4][3]), (0.5 * SH_FIRST, 0.5 * SH_REST));
    }

    /// The edge is 3 widths from the centre, and no farther than the edge of the clip.
    #[test]
    fn motion_moves_each_gaussian_as_far_at_its_edge_as_its_centre() {
        let parameters = Parameters { tau: vec![0.0], log_widths: vec![0.0], ..Parameters::default() };
        let rates = LearningRates::new(10.0, Timeline::even(33), &parameters);
        for (width, edge) in [(2.0, 6.0), (5.0, 15.0), (8.0, 16.0), (f64::INFINITY, 16.0), (0.01, 1.0)] {
            let [c1, c2, c3] = rates.scaled(0.5).motion(f64::ln(width));
            for step in [c1 * edge, c2 * edge * edge, c3 * edge * edge * edge] {
                assert!((step - 0.5 * rates.centers).abs() < 1e-12, "{width}: {step}");
            }
        }
    }

    #[test]
    fn rates_of_a_static_field_are_lower() {
        let timed = Parameters::<f64> { tau: vec![0.0], log_widths: vec![0.0], ..Parameters::default() };
        let fixed = LearningRates::new(2.0, Timeline::even(9), &Parameters::<f64>::default());
        let rates = LearningRates::new(2.0, Timeline::even(9), &timed);
        let share = f64::from(STATIC_SHARE);
        assert_eq!((rates.centers, fixed.centers), (2.0 * CENTERS, share * (2.0 * CENTERS)));
        assert_eq!((fixed.logits, fixed.sh_rest), (share * LOGITS, share * SH_REST));
    }
}
