//! [`median`] of numbers.

/// Median, the upper one for even lengths; `None` for no values.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let half = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(half, f64::total_cmp).1)
}
