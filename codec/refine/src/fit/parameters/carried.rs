//! [`Carried`]: what a fit that goes on from an earlier one knows of each Gaussian.
//!
//! A long take is fitted window by window of its time. A Gaussian that lives across the start of a window was fitted to
//! photographs that are no longer in memory. Its steps are shorter by the share of its life that the photographs
//! in memory show: a mean over windows, as of photographs within one. And none may be born in time of which no
//! photograph is left.

use serde::{Deserialize, Serialize};

use super::bounds::Bounds;
use super::columns::Parameters;
use crate::fit::precision::Real;

/// The past of a Gaussian in a fit that goes on from an earlier one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Carried {
    /// Share of its life up to the last photograph that the photographs of this fit show, 0 to 1; weighted by the
    /// opacity over time. The learning rates are multiplied by it. Capacity control leaves rows below 1 as they are.
    pub share: f32,
    /// Earliest time, in intervals, at which it may be alive; -infinity if any will do.
    pub birth: f32,
    /// Whether it stands still and is always on: only what does not depend on time is fitted.
    pub is_static: bool,
}

impl Carried {
    /// No past.
    pub const NONE: Carried = Carried { share: 1.0, birth: f32::NEG_INFINITY, is_static: false };

    /// Whether all of its life so far is in the photographs of this fit.
    pub(in crate::fit) fn is_own(self) -> bool {
        self.share >= 1.0
    }
}

/// Narrows windows that begin before [`Carried::birth`], and moves those that would become narrower than the bounds
/// allow; trajectories stay. `carried` has an entry for each row, or none.
pub(in crate::fit) fn keep_births<T: Real>(
    parameters: &mut Parameters<T>,
    carried: &[Carried],
    bounds: &Bounds,
) {
    if parameters.tau.is_empty() {
        return;
    }
    let width_min = libm::exp(bounds.log_widths[0]);
    for (row, Carried { birth, .. }) in carried.iter().enumerate() {
        let (tau, width) =
            (parameters.tau[row].to_double(), libm::exp(parameters.log_widths[row].to_double()));
        let birth = f64::from(*birth);
        let support_radius = parameters.support_radius(row);
        // NaN stays as it is.
        if tau - support_radius * width < birth {
            let narrower = ((tau - birth) / support_radius).max(width_min);
            parameters.log_widths[row] = T::from_f64(libm::log(narrower));
            let earliest = birth + support_radius * narrower;
            if tau < earliest {
                parameters.center_window(row, T::from_f64(earliest));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::parameters::Timeline;

    fn parameters(tau: f64, width: f64) -> Parameters<f64> {
        Parameters {
            centers: vec![[1.0, 2.0, 3.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-3.0; 3]],
            logits: vec![0.0],
            sh: vec![[0.0; 3]],
            tau: vec![tau],
            log_widths: vec![libm::log(width)],
            motion_order: 1,
            motion: vec![[0.5, 0.0, 0.0]],
            ..Parameters::default()
        }
    }

    fn birth(parameters: &Parameters<f64>) -> f64 {
        let opacity = 1.0 / (1.0 + libm::exp(-parameters.logits[0]));
        parameters.tau[0] - libm::exp(parameters.log_widths[0]) * (2.0 * libm::log(255.0 * opacity)).sqrt()
    }

    #[test]
    fn no_window_begins_before_its_birth() {
        let bounds = Bounds::new(1.0, Timeline::even(9));
        for (tau, width, least) in [(4.0, 2.0, 0.0), (0.5, 2.0, 0.0), (-3.0, 0.5, -1.0), (4.0, 0.6, -30.0)] {
            let mut kept = parameters(tau, width);
            let before = kept.clone();
            keep_births(&mut kept, &[Carried { birth: least, ..Carried::NONE }], &bounds);
            assert!(birth(&kept) >= f64::from(least) - 1e-9, "{}", birth(&kept));
            // The Gaussian is where it was, at any time.
            let at = |parameters: &Parameters<f64>, time: f64| {
                parameters.centers[0][0] + parameters.motion[0][0] * (time - parameters.tau[0])
            };
            assert!((at(&kept, 5.0) - at(&before, 5.0)).abs() < 1e-12);
            assert!(
                kept.log_widths[0] <= before.log_widths[0] && kept.log_widths[0] >= libm::log(0.5) - 1e-12
            );
            if birth(&before) >= f64::from(least) {
                assert_eq!(kept, before);
            }
        }
    }

    #[test]
    fn a_window_that_is_always_on_ends_where_photographs_begin() {
        let bounds = Bounds::new(1.0, Timeline::even(9));
        let mut kept = parameters(4.0, 100.0);
        keep_births(&mut kept, &[Carried { birth: 0.0, ..Carried::NONE }], &bounds);
        assert!(birth(&kept).abs() < 1e-9);
        let mut nan = parameters(f64::NAN, 1.0);
        keep_births(&mut nan, &[Carried { birth: 0.0, ..Carried::NONE }], &bounds);
        assert!(nan.tau[0].is_nan() && nan.log_widths[0] == 0.0);
    }
}
