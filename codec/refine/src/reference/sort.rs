//! Stage `sort`: front to back.

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
    match order {
        Order::Depth => splats.sort_by(|a, b| a.depth.total_cmp(&b.depth)),
        Order::Radial => splats.sort_by(|a, b| a.distance.total_cmp(&b.distance)),
    }
}
