//! [`for_each_in_order`]: work on several items at once, whose results are taken in order.
//!
//! Part of the work on a picture is serial: sorting, and sums over pixels. Work on several pictures at once fills that
//! time, and memory holds no more results than there are threads.

use rayon::prelude::*;

/// Computes `work` of each of `items`, as many at once as there are threads, and gives the results to `take` in the
/// order of the items.
pub(crate) fn for_each_in_order<T: Sync, R: Send>(
    items: &[T],
    work: impl Fn(&T) -> R + Sync,
    mut take: impl FnMut(&T, R),
) {
    for some in items.chunks(rayon::current_num_threads()) {
        let results: Vec<R> = some.par_iter().map(&work).collect();
        some.iter().zip(results).for_each(|(item, result)| take(item, result));
    }
}
