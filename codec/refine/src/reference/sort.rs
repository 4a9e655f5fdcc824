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
pub(crate) fn sort(splats: &mut Vec<Splat>, order: Order) {
    // Keys are a sixth of the size of splats. Distances in front of the camera have the order of their bits.
    let key = |(index, splat): (usize, &Splat)| (distance(splat, order).to_bits(), index as u32);
    let mut keys: Vec<(u64, u32)> = splats.iter().enumerate().map(key).collect();
    keys.sort_unstable();
    *splats = keys.iter().map(|&(_, index)| splats[index as usize]).collect();
}

/// Compares two splats: `a` is less if it is in front of `b`.
pub(crate) fn nearer(a: &Splat, b: &Splat, order: Order) -> Ordering {
    distance(a, order).total_cmp(&distance(b, order))
}

/// The positive distance by which splats are ordered.
fn distance(splat: &Splat, order: Order) -> f64 {
    match order {
        Order::Depth => splat.depth,
        Order::Radial => splat.distance,
    }
}
