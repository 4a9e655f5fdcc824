//! Stage `sort`: orders splats front to back.

use rayon::prelude::*;

use super::real::Real;

/// The indices of splats front to back, given whether a splat is behind all splats that are not, and its distance, which is
/// not NaN. Splats with equal keys keep their order.
pub(crate) fn front_to_back<T: Real>(keys: impl Iterator<Item = (bool, T)>) -> Vec<u32> {
    let mut order: Vec<(bool, T, u32)> =
        (0..).zip(keys).map(|(index, (behind, distance))| (behind, distance, index)).collect();
    order.par_sort_unstable_by(|(behind, a, i), (other_behind, b, j)| {
        let by_distance = a.partial_cmp(b).expect("distances of splats are finite");
        behind.cmp(other_behind).then(by_distance).then(i.cmp(j))
    });
    order.into_iter().map(|(.., index)| index).collect()
}
