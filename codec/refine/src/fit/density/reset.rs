//! [`reset_opacities`]: makes all Gaussians nearly transparent, as 3D Gaussian Splatting does (Kerbl et al. 2023,
//! section 5.2): those that the pictures need become opaque again, the others are pruned.
//!
//! A Gaussian with a window is in few pictures, and may be pruned before these have come round.

use super::relocate::sigmoid;
use crate::fit::optimizer::Moments;
use crate::fit::parameters::Parameters;
use crate::raster::Real;

/// Steps between resets in 3D Gaussian Splatting.
pub(super) const RESET_INTERVAL: usize = 3000;

/// Largest opacity after a reset.
const OPACITY: f64 = 0.01;

/// Lowers all opacities to at most 0.01 and clears their moments.
pub(super) fn reset_opacities<T: Real>(parameters: &mut Parameters<T>, moments: &mut Moments<T>) {
    let largest = T::from_f64(libm::log(OPACITY / (1.0 - OPACITY)));
    for logit in parameters.logits.iter_mut().filter(|logit| sigmoid(logit.to_double()) > OPACITY) {
        *logit = largest;
    }
    moments.first.logits.fill(T::zero());
    moments.second.logits.fill(T::zero());
}
