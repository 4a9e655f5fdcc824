//! Stage `sort`: front to back.

use std::cmp::Ordering;

use super::evaluate::Splat;

/// What "in front of" means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// By the distance of the centre along the camera's axis, as fitted fields expect.
    #[default]
    Depth,
    /// By the distance of the centre from the eye: does not change when the head turns.
    Radial,
}

/// Sorts front to back; splats at one depth keep their order.
pub(crate) fn sort(splats: &mut [Splat], order: Order) {
    splats.sort_by(|a, b| nearer(a, b, order));
}

/// Whether `a` is in front of `b`: then it is less.
pub(crate) fn nearer(a: &Splat, b: &Splat, order: Order) -> Ordering {
    match order {
        Order::Depth => a.depth.total_cmp(&b.depth),
        Order::Radial => a.distance.total_cmp(&b.distance),
    }
}
