//! [`densify`]: clones small Gaussians and splits large ones where the screen-space gradient is high, as
//! in 3D Gaussian Splatting (Kerbl et al. 2023, section 5.2), with the thresholds of gsplat.

use super::ScreenGradients;
use crate::fit::optimizer::Moments;
use crate::fit::parameters::{Bounds, Parameters};
use crate::raster::Real;

/// Mean screen-space gradient above which a Gaussian is densified.
const GRADIENT_MIN: f64 = 2e-4;

/// Largest standard deviation of a Gaussian that is cloned instead of split, as a fraction of the extent.
const CLONE_SCALE: f64 = 0.01;

/// Divisor of the scales of the halves of a split Gaussian.
const SPLIT_SHRINK: f64 = 1.6;

/// Clones and splits the Gaussians with the highest mean screen-space gradient until there are `cap`
/// of them. The order afterwards: untouched and cloned originals in their order, then clones, then the
/// halves of split ones. New rows have no moments. Returns how many were cloned and split.
pub(super) fn densify<T: Real>(
    cap: usize,
    gradients: &ScreenGradients,
    parameters: &mut Parameters<T>,
    moments: &mut Moments<T>,
    bounds: &Bounds,
    random: &mut fastrand::Rng,
) -> (usize, usize) {
    let count = parameters.len();
    let mut selected: Vec<usize> =
        (0..count).filter(|row| gradients.mean(*row) > GRADIENT_MIN && moments.is_own(*row)).collect();
    selected.sort_unstable_by(|&a, &b| gradients.mean(b).total_cmp(&gradients.mean(a)).then(a.cmp(&b)));
    selected.truncate(cap.saturating_sub(count));
    selected.sort_unstable();
    let largest = T::from_f64(libm::log(CLONE_SCALE * bounds.extent));
    let is_small = |row: &usize| parameters.log_scales[*row].iter().all(|scale| *scale <= largest);
    let (cloned, split): (Vec<usize>, Vec<usize>) = selected.iter().partition(|row| is_small(row));

    let mut sources: Vec<usize> = (0..count).filter(|row| split.binary_search(row).is_err()).collect();
    let first_new = sources.len();
    sources.extend(&cloned);
    let first_half = sources.len();
    sources.extend(split.iter().flat_map(|row| [*row; 2]));
    *parameters = parameters.select(&sources);
    *moments = moments.select(&sources);
    for row in first_new..sources.len() {
        moments.clear(row);
    }
    for row in first_half..sources.len() {
        halve(parameters, row, random);
        bounds.project(parameters.row_mut(row));
    }
    (cloned.len(), split.len())
}

/// Replaces a row by a half of it: a centre drawn from the Gaussian, and smaller scales. Window, motion,
/// opacity and colour stay.
pub(super) fn halve<T: Real>(parameters: &mut Parameters<T>, row: usize, random: &mut fastrand::Rng) {
    let [w, x, y, z] = parameters.rotations[row].map(T::to_double);
    let rotation = glam::DQuat::from_xyzw(x, y, z, w).normalize();
    let scales = parameters.log_scales[row].map(|scale| libm::exp(scale.to_double()));
    let along_axes = glam::DVec3::from_array(scales.map(|scale| scale * normal(random)));
    for (center, offset) in parameters.centers[row].iter_mut().zip((rotation * along_axes).to_array()) {
        *center += T::from_f64(offset);
    }
    let shrink = T::from_f64(libm::log(SPLIT_SHRINK));
    parameters.log_scales[row] = parameters.log_scales[row].map(|scale| scale - shrink);
}

/// A sample of the standard normal distribution (Box and Muller).
fn normal(random: &mut fastrand::Rng) -> f64 {
    let (radius, angle) = (1.0 - random.f64(), std::f64::consts::TAU * random.f64());
    (-2.0 * libm::log(radius)).sqrt() * libm::cos(angle)
}
