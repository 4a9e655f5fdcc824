//! [`place`]: centres in a field, about another origin where `f32` is too coarse for them.

use codec::Field;

use crate::imported::Imported;
use crate::limits::ImportBudget;

/// Largest median error of centres in `f32`, in typical standard deviations, before they are read about another origin: a
/// Gaussian moved by that much looks the same.
const CENTER_ERROR_MAX: f64 = 0.01;

/// Gives a field, whose scales are there, the exact centres of its rows; where they are too far from the origin for `f32`,
/// about their median, which the hints and a note state.
///
/// # Errors
/// As [`ImportBudget::vec`] has them.
pub(crate) fn place(
    imported: &mut Imported,
    exact: impl Fn(usize) -> [f64; 3],
    budget: &mut ImportBudget,
) -> Result<(), String> {
    let origin = origin(&imported.field, &exact, budget)?;
    let start = origin.unwrap_or_default();
    let rows = 0..imported.field.log_scales.len();
    let relative = |row| {
        let exact = exact(row);
        [0, 1, 2].map(|axis| (exact[axis] - start[axis]) as f32)
    };
    imported.field.centers.extend(rows.map(relative));
    imported.hints.origin = origin;
    let [x, y, z] = start;
    let note = || format!("centres are relative to {x} {y} {z}: 32-bit numbers are too coarse there");
    imported.account.assumed.extend(origin.map(|_| note()));
    Ok(())
}

/// The origin to which centres must be relative, the median of each coordinate; `None` if `f32` holds them as they are.
fn origin(
    field: &Field,
    exact: &impl Fn(usize) -> [f64; 3],
    budget: &mut ImportBudget,
) -> Result<Option<[f64; 3]>, String> {
    let rows = 0..field.log_scales.len();
    let error =
        |row: usize| exact(row).map(|x| (x - f64::from(x as f32)).abs()).into_iter().fold(0.0, f64::max);
    if rows.clone().all(|row| error(row) == 0.0) {
        return Ok(None);
    }
    let mut values = budget.vec(rows.len())?;
    let mut median = |of_row: &dyn Fn(usize) -> f64| {
        values.clear();
        values.extend(rows.clone().map(of_row).filter(|x| x.is_finite()));
        let middle = values.len() / 2;
        (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
    };
    let scale =
        |row: usize| field.log_scales[row].map(f64::from).into_iter().fold(f64::NEG_INFINITY, f64::max);
    let typical = median(&scale).map_or(f64::INFINITY, f64::exp);
    // A stray far away is no reason.
    if median(&error).is_none_or(|error| error <= CENTER_ERROR_MAX * typical) {
        return Ok(None);
    }
    Ok(Some([0, 1, 2].map(|axis| median(&|row| exact(row)[axis]).unwrap_or(0.0))))
}
