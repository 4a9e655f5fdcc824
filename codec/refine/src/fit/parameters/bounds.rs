//! [`Bounds`]: the feasible set of a fit.
//!
//! Outside it gradients vanish or explode: scales run away, saturated opacities get no gradient back,
//! and windows collapse to less than an interval, so that each photograph has Gaussians of its own and
//! instants between photographs show ghosts.

use serde::{Deserialize, Serialize};

use super::columns::{COLUMNS, LOGIT_MAX, Parameters};
use super::timeline::Timeline;
use crate::raster::Real;

/// Smallest and largest standard deviation, as fractions of the scene's extent.
const SCALES: [f64; 2] = [1e-4, 0.1];

/// Smallest window width in intervals: a narrower one would not show at the instant halfway between two photographs.
const WIDTH_MIN: f64 = 0.5;

/// Largest window width in clips: the opacity of a wider one would change by less than 1/510 over the clip, which no
/// picture shows.
const WIDTH_MAX: f64 = 16.0;

/// Intervals by which a window centre may precede the first frame or follow the last.
const TAU_MARGIN: f64 = 0.5;

/// Margin above the largest log-scale of a field that was fitted under other bounds.
const SCALE_MARGIN: f64 = 0.1;

/// A quaternion shorter than this has no direction.
pub(in crate::fit) const NORM_MIN: f64 = 1e-12;

/// Smallest and largest values of the parameters. Logits lie in `[-LOGIT_MAX, LOGIT_MAX]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::fit) struct Bounds {
    /// Extent of the scene in units of the capture, see [`scene_extent`](super::scene_extent).
    pub(in crate::fit) extent: f64,
    /// For the logarithms of the standard deviations.
    pub(in crate::fit) log_scales: [f64; 2],
    /// For the logarithms of the window widths in intervals.
    pub(in crate::fit) log_widths: [f64; 2],
    /// For the window centres, in intervals.
    pub(in crate::fit) tau: [f64; 2],
}

impl Bounds {
    /// Scales from 0.0001 to 0.1 of `extent`, windows from 0.5 intervals to 16 clips wide, centred at most
    /// half an interval outside the clip.
    pub(in crate::fit) fn new(extent: f64, timeline: Timeline) -> Bounds {
        Bounds {
            extent,
            log_scales: SCALES.map(|part| libm::log(part * extent)),
            log_widths: [WIDTH_MIN, WIDTH_MAX * timeline.intervals].map(libm::log),
            tau: [-TAU_MARGIN, timeline.intervals + TAU_MARGIN],
        }
    }

    /// Widens the bounds to contain all finite `parameters`, for a field that was fitted under other
    /// bounds. The largest scale gets a margin, because a Gaussian that moves and is at the bound counts as a floater.
    pub(in crate::fit) fn around<T: Real>(mut self, parameters: &Parameters<T>) -> Bounds {
        let widen = |bounds: &mut [f64; 2], values: &[T]| {
            for x in values.iter().map(|x| x.to_double()).filter(|x| x.is_finite()) {
                *bounds = [bounds[0].min(x), bounds[1].max(x)];
            }
        };
        let usual = self.log_scales[1];
        widen(&mut self.log_scales, parameters.log_scales.as_flattened());
        if self.log_scales[1] > usual {
            self.log_scales[1] += SCALE_MARGIN;
        }
        widen(&mut self.log_widths, &parameters.log_widths);
        widen(&mut self.tau, &parameters.tau);
        self
    }

    /// Clamps a row, given by its [columns](Parameters::columns), to the bounds. A quaternion without a direction becomes
    /// the identity. NaN stays.
    pub(in crate::fit) fn project<T: Real>(&self, row: [&mut [T]; COLUMNS]) {
        let [_, rotation, log_scales, logit, _, tau, log_width, ..] = row;
        let clamp = |column: &mut [T], [least, greatest]: [f64; 2]| {
            for x in column.iter_mut().filter(|x| !x.is_nan()) {
                *x = x.max(T::from_f64(least)).min(T::from_f64(greatest));
            }
        };
        clamp(log_scales, self.log_scales);
        clamp(logit, [-LOGIT_MAX, LOGIT_MAX]);
        clamp(tau, self.tau);
        clamp(log_width, self.log_widths);
        let norm = rotation.iter().map(|x| x.to_double().powi(2)).sum::<f64>().sqrt();
        if norm < NORM_MIN {
            rotation.copy_from_slice(&[T::one(), T::zero(), T::zero(), T::zero()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> Parameters<f64> {
        Parameters {
            centers: vec![[100.0, -5.0, 0.0]],
            rotations: vec![[1e-13, 0.0, -1e-13, 0.0]],
            log_scales: vec![[-50.0, 50.0, -1.0]],
            logits: vec![-30.0],
            sh: vec![[0.0; 3]],
            tau: vec![-4.0],
            log_widths: vec![-2.0],
            ..Parameters::default()
        }
    }

    #[test]
    fn a_row_is_clamped() {
        let bounds = Bounds::new(10.0, Timeline::even(9));
        let mut parameters = row();
        bounds.project(parameters.row_mut(0));
        let [a, b, c] = parameters.log_scales[0].map(f64::exp);
        assert!((a - 1e-3).abs() < 1e-12 && (b - 1.0).abs() < 1e-12 && (c - (-1.0_f64).exp()).abs() < 1e-12);
        assert_eq!(
            (parameters.logits[0], parameters.tau[0], parameters.log_widths[0]),
            (-7.0, -0.5, libm::log(0.5))
        );
        assert_eq!(parameters.rotations[0], [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(parameters.centers[0], row().centers[0]);
        parameters.tau[0] = 12.0;
        bounds.project(parameters.row_mut(0));
        assert_eq!(parameters.tau[0], 8.5);
        let projected = parameters.clone();
        bounds.project(parameters.row_mut(0));
        assert_eq!(parameters, projected);
    }

    #[test]
    fn a_scene_without_time_has_no_windows() {
        let mut parameters = Parameters { tau: Vec::new(), log_widths: Vec::new(), ..row() };
        Bounds::new(1.0, Timeline::even(1)).project(parameters.row_mut(0));
        assert_eq!(parameters.logits[0], -7.0);
    }

    #[test]
    fn a_fitted_field_widens_the_bounds() {
        let mut parameters = row();
        parameters.tau.push(f64::NAN);
        let bounds = Bounds::new(10.0, Timeline::even(9)).around(&parameters);
        assert_eq!((bounds.log_scales, bounds.tau), ([-50.0, 50.0 + SCALE_MARGIN], [-4.0, 8.5]));
        assert_eq!(bounds.log_widths, [-2.0, libm::log(16.0 * 8.0)]);
    }
}
