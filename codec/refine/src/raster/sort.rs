//! Stage `sort`: orders splats front to back.

use rayon::prelude::*;

use super::real::Real;

/// The place of a splat among others: whether it is behind all that are not, then its distance, then its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SortKey(u128);

impl SortKey {
    /// The key of a splat at a distance, which is not NaN.
    pub(crate) fn new<T: Real>(is_behind: bool, distance: T, index: u32) -> SortKey {
        debug_assert!(!distance.is_nan(), "distances of splats are numbers");
        // Of -0 and 0, which are equal, 0.
        let bits = (distance.to_double() + 0.0).to_bits();
        // Integers in the order of the numbers.
        let ascending = if bits >> 63 == 0 { bits | 1 << 63 } else { !bits };
        SortKey(u128::from(is_behind) << 96 | u128::from(ascending) << 32 | u128::from(index))
    }
}

/// The indices of splats front to back. Splats at equal distances are in the order of their indices.
pub(crate) fn front_to_back(mut keys: Vec<SortKey>) -> Vec<u32> {
    keys.par_sort_unstable();
    keys.into_iter().map(|SortKey(key)| key as u32).collect()
}
