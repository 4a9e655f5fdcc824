//! Stage `sort`: orders splats front to back.

use crate::raster::{SortKey, Splat, front_to_back};

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
pub(crate) fn sort(splats: &mut Vec<Splat<f64>>, order: Order) {
    sort_by(splats, order, |splat| splat);
}

/// Sorts what has splats as [`sort`] does.
pub(crate) fn sort_by<S: Clone>(list: &mut Vec<S>, order: Order, splat: impl Fn(&S) -> &Splat<f64>) {
    let distance = |splat: &Splat<f64>| match order {
        Order::Depth => splat.depth,
        Order::Radial => splat.distance,
    };
    let keys = (0..).zip(&*list).map(|(index, item)| SortKey::new(false, distance(splat(item)), index));
    let indices = front_to_back(keys.collect());
    *list = indices.into_iter().map(|index| list[index as usize].clone()).collect();
}
