//! The columns of [`Parameters`] as plain rows of numbers, for what is done to all of them alike.

use super::{Parameters, Real};

/// Number of columns.
pub(super) const COLUMNS: usize = 9;

/// The columns, row after row.
pub(super) fn columns<T>(parameters: &Parameters<T>) -> [&[T]; COLUMNS] {
    [
        parameters.centers.as_flattened(),
        parameters.rotations.as_flattened(),
        parameters.log_scales.as_flattened(),
        &parameters.logits,
        parameters.sh.as_flattened(),
        &parameters.tau,
        &parameters.log_widths,
        parameters.motion.as_flattened(),
        parameters.rotation_rates.as_flattened(),
    ]
}

/// [`columns`], to change.
pub(super) fn columns_mut<T>(parameters: &mut Parameters<T>) -> [&mut [T]; COLUMNS] {
    [
        parameters.centers.as_flattened_mut(),
        parameters.rotations.as_flattened_mut(),
        parameters.log_scales.as_flattened_mut(),
        &mut parameters.logits,
        parameters.sh.as_flattened_mut(),
        &mut parameters.tau,
        &mut parameters.log_widths,
        parameters.motion.as_flattened_mut(),
        parameters.rotation_rates.as_flattened_mut(),
    ]
}

/// Numbers of one row among `count` rows of a column; none of an empty column.
pub(super) fn of_row<T>(column: &[T], count: usize, row: usize) -> &[T] {
    let per_row = column.len() / count.max(1);
    &column[row * per_row..(row + 1) * per_row]
}

/// Whether all numbers of a row are finite.
pub(super) fn is_finite<T: Real>(parameters: &Parameters<T>, row: usize) -> bool {
    let count = parameters.len();
    columns(parameters).iter().all(|column| of_row(column, count, row).iter().all(|x| x.is_finite()))
}
