//! [`prune`]: drops transparent Gaussians and floaters, but never below the capacity floor (the paper's
//! Eq. 8).

use super::DensityChange;
use super::floaters::floaters;
use super::relocate::sigmoid;
use crate::fit::optimizer::Moments;
use crate::fit::parameters::{Bounds, Parameters};
use crate::raster::Real;

/// Peak opacity below which a Gaussian is transparent.
const OPACITY_MIN: f64 = 0.005;

/// Drops transparent Gaussians and floaters. If fewer than `floor` would be left in front of the plate, keeps that many of
/// these: the most opaque that do not float, then the most opaque floaters, the first of equals. Rows with non-finite numbers
/// always go.
pub(super) fn prune<T: Real>(
    floor: usize,
    parameters: &mut Parameters<T>,
    moments: &mut Moments<T>,
    bounds: &Bounds,
    change: &mut DensityChange,
) {
    let count = parameters.len();
    let mut floating = floaters(parameters, |row| moments.is_static(row), bounds);
    (0..count).for_each(|row| floating[row] &= moments.is_own(row));
    let stays = |row: usize| parameters.is_finite(row) && !moments.is_own(row);
    let mut kept: Vec<usize> =
        (0..count).filter(|&row| stays(row) || !floating[row] && is_opaque(parameters, row)).collect();
    let unbounded = kept.len();
    let is_in_front = |row: &usize| !parameters.is_behind(*row);
    if kept.iter().filter(|row| is_in_front(row)).count() < floor {
        kept.retain(|row| !is_in_front(row));
        let mut in_front: Vec<usize> =
            (0..count).filter(|row| is_in_front(row) && parameters.is_finite(*row)).collect();
        let logit = |row: usize| parameters.logits[row].to_double();
        in_front.sort_unstable_by(|&a, &b| {
            let by_opacity = logit(b).total_cmp(&logit(a));
            (!stays(a), floating[a]).cmp(&(!stays(b), floating[b])).then(by_opacity).then(a.cmp(&b))
        });
        kept.extend(in_front.into_iter().take(floor));
        kept.sort_unstable();
    }
    change.floaters = floating.iter().filter(|floats| **floats).count();
    change.retained = kept.len() - unbounded;
    change.pruned = count - kept.len();
    if kept.len() < count {
        *parameters = parameters.select(&kept);
        *moments = moments.select(&kept);
    }
}

/// Whether a Gaussian is finite and opaque enough at its peak.
pub(super) fn is_opaque<T: Real>(parameters: &Parameters<T>, row: usize) -> bool {
    parameters.is_finite(row) && sigmoid(parameters.logits[row].to_double()) >= OPACITY_MIN
}
