//! Stage `sort`: orders splats front to back.

use std::cmp::Ordering;

use super::evaluate::Splat;

/// Sort key of Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Distance of the centre along the optical axis, as in fitting.
    #[default]
    Depth,
    /// Distance of the centre from the eye: invariant to head rotation.
    Radial,
}

/// Sorts front to back; the sort is stable.
pub(crate) fn sort(splats: &mut [Splat], order: Order) {
    splats.sort_by(|a, b| nearer(a, b, order));
}

/// Compares two splats: `a` is less if it is in front of `b`.
pub(crate) fn nearer(a: &Splat, b: &Splat, order: Order) -> Ordering {
    match order {
        Order::Depth => a.depth.total_cmp(&b.depth),
        Order::Radial => a.distance.total_cmp(&b.distance),
    }
}
