//! [`Carried`]: what a fit that goes on from earlier ones knows of each Gaussian.
//!
//! A long take is fitted window by window of its time. A Gaussian that lives across the end of a window was fitted to
//! photographs that are no longer in memory. Its steps are shorter by the share of its life that the photographs
//! in memory show: a mean over windows, as of photographs within one. And none may be alive in time that an earlier fit
//! has finished.

use serde::{Deserialize, Serialize};

use super::bounds::Bounds;
use super::columns::Parameters;
use crate::raster::Real;

/// Factor of the rates of a static row among others: all photographs show it, so it moves in more of the steps, and
/// shorter ones suffice. Measured on NeRF's chair.
pub(in crate::fit) const STATIC_SHARE: f32 = 0.4;

/// What is known of a Gaussian in a fit that goes on from earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Carried {
    /// Share of its life that the photographs of this fit show, of the share that they and the photographs of earlier
    /// fits show, 0 to 1; weighted by the opacity over time. The learning rates are multiplied by it. Capacity control
    /// leaves rows below 1 as they are.
    pub share: f32,
    /// Earliest and latest time, in intervals, at which it may be alive; infinite if any will do.
    pub limits: [f32; 2],
    /// Whether it stands still and is always on: only what does not depend on time is fitted, in shorter steps, since all
    /// photographs show it. Capacity control makes static rows of it.
    pub is_static: bool,
}

impl Carried {
    /// No past.
    pub const NONE: Carried =
        Carried { share: 1.0, limits: [f32::NEG_INFINITY, f32::INFINITY], is_static: false };

    /// It stands still and is always on.
    pub const STATIC: Carried = Carried { is_static: true, ..Carried::NONE };

    /// Finished: it is drawn, and stays as it is.
    pub const FIXED: Carried = Carried { share: 0.0, ..Carried::NONE };

    /// Whether it stays as it is.
    pub fn is_fixed(self) -> bool {
        self.share <= 0.0
    }

    /// Whether no other fit has a part in it.
    pub(in crate::fit) fn is_own(self) -> bool {
        self.share >= 1.0
    }

    /// Factor of its rates.
    pub(in crate::fit) fn share_of_rates(self) -> f32 {
        if self.is_static { STATIC_SHARE * self.share } else { self.share }
    }

    /// Factor of the rates of its window, motion and rotation.
    pub(in crate::fit) fn share_of_time(self) -> f32 {
        if self.is_static { 0.0 } else { self.share }
    }
}

/// Narrows windows that reach beyond [`Carried::limits`], and moves those that would become narrower than the bounds
/// allow; trajectories stay. `carried` has an entry for each row, or none.
pub(in crate::fit) fn keep_limits<T: Real>(
    parameters: &mut Parameters<T>,
    carried: &[Carried],
    bounds: &Bounds,
) {
    if parameters.tau.is_empty() {
        return;
    }
    let width_min = libm::exp(bounds.log_widths[0]);
    for (row, Carried { limits, .. }) in carried.iter().enumerate() {
        let (tau, width) =
            (parameters.tau[row].to_double(), libm::exp(parameters.log_widths[row].to_double()));
        let [birth, death] = limits.map(f64::from);
        let support_radius = parameters.support_radius(row);
        // NaN stays as it is.
        if tau - support_radius * width < birth || tau + support_radius * width > death {
            let narrower = ((tau - birth).min(death - tau) / support_radius).min(width).max(width_min);
            parameters.log_widths[row] = T::from_f64(libm::log(narrower));
            let half_life = support_radius * narrower;
            // Where even the narrowest window is too wide, in the middle.
            let inside = if birth + half_life < death - half_life {
                tau.clamp(birth + half_life, death - half_life)
            } else {
                0.5 * (birth + death)
            };
            if tau != inside {
                parameters.center_window(row, T::from_f64(inside));
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

    /// Birth and death.
    fn life(parameters: &Parameters<f64>) -> [f64; 2] {
        let opacity = 1.0 / (1.0 + libm::exp(-parameters.logits[0]));
        let half_life = libm::exp(parameters.log_widths[0]) * (2.0 * libm::log(255.0 * opacity)).sqrt();
        [-1.0, 1.0].map(|side| parameters.tau[0] + side * half_life)
    }

    fn limited(limits: [f32; 2]) -> [Carried; 1] {
        [Carried { limits, ..Carried::NONE }]
    }

    #[test]
    fn no_window_reaches_beyond_its_limits() {
        let bounds = Bounds::new(1.0, Timeline::even(9));
        let none = f32::INFINITY;
        for (tau, width, limits) in [
            (4.0, 2.0, [0.0, none]),
            (0.5, 2.0, [0.0, none]),
            (-3.0, 0.5, [-1.0, none]),
            (4.0, 0.6, [-30.0, none]),
            (4.0, 2.0, [-none, 8.0]),
            (7.5, 2.0, [-none, 8.0]),
            (12.0, 0.5, [-none, 9.0]),
            (4.0, 3.0, [0.0, 8.0]),
            (1.0, 3.0, [0.0, 8.0]),
            (7.9, 100.0, [0.0, 8.0]),
        ] {
            let mut kept = parameters(tau, width);
            let before = kept.clone();
            keep_limits(&mut kept, &limited(limits), &bounds);
            let ([birth, death], [least, most]) = (life(&kept), limits.map(f64::from));
            assert!(birth >= least - 1e-9 && death <= most + 1e-9, "{birth} {death}, {limits:?}");
            // The Gaussian is where it was, at any time.
            let at = |parameters: &Parameters<f64>, time: f64| {
                parameters.centers[0][0] + parameters.motion[0][0] * (time - parameters.tau[0])
            };
            assert!((at(&kept, 5.0) - at(&before, 5.0)).abs() < 1e-12);
            assert!(
                kept.log_widths[0] <= before.log_widths[0] && kept.log_widths[0] >= libm::log(0.5) - 1e-12
            );
            let [birth, death] = life(&before);
            if birth >= least && death <= most {
                assert_eq!(kept, before);
            }
        }
    }

    #[test]
    fn extreme_windows_and_limits_stay_finite() {
        let bounds = Bounds::new(1.0, Timeline::even(9));
        let mut kept = parameters(4.0, 100.0);
        keep_limits(&mut kept, &limited([0.0, f32::INFINITY]), &bounds);
        assert!(life(&kept)[0].abs() < 1e-9, "one that is always on ends where photographs begin");
        // No window is narrow enough for these.
        let mut kept = parameters(20.0, 100.0);
        keep_limits(&mut kept, &limited([3.0, 4.0]), &bounds);
        assert_eq!((kept.tau[0], kept.log_widths[0]), (3.5, libm::log(0.5)));
        let mut nan = parameters(f64::NAN, 1.0);
        keep_limits(&mut nan, &limited([0.0, 8.0]), &bounds);
        assert!(nan.tau[0].is_nan() && nan.log_widths[0] == 0.0);
    }
}
