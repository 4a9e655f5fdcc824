//! [`Numbers`]: a value for each number that is rounded jointly, such as its gradient.

use codec::Field;

use crate::fit::{Gradient, Parameters};

/// Number of columns that are rounded jointly.
const COLUMNS: usize = 3;

/// Index of the logarithms of the scales.
const SCALES: usize = 1;

/// Error of a logarithm of a scale above which it is not moved: the coder keeps no detail below a pixel, and the
/// derivative does not tell what that does.
const SCALE_ERROR_MAX: f64 = 0.2;

/// A value for each number of a field that is rounded jointly.
#[derive(Clone, Debug)]
pub(super) struct Numbers {
    /// Centres, logarithms of the scales, and spherical harmonics, flattened. Rounding opacities jointly as well gained
    /// 0.02 dB, rotations nothing; motion lost quality in views that were not looked at.
    pub(super) columns: [Vec<f64>; COLUMNS],
}

impl Numbers {
    /// Zeros for the numbers of a field.
    pub(super) fn zeros(field: &Field) -> Numbers {
        Numbers { columns: columns(field).map(|column| vec![0.0; column.len()]) }
    }

    /// Typical rounding errors of the numbers of a field: the root mean squares in each row, whose numbers have the same
    /// step. 0 for logarithms of scales that must not move.
    pub(super) fn errors(field: &Field, decoded: &Field) -> Numbers {
        let rows = field.len().max(1);
        let mut numbers = Numbers::zeros(field);
        for (k, (from, to)) in columns(field).into_iter().zip(columns(decoded)).enumerate() {
            let per_row = from.len() / rows;
            let errors: Vec<f64> = from.iter().zip(to).map(|(a, b)| f64::from(*b) - f64::from(*a)).collect();
            for (errors, typical) in errors.chunks(per_row).zip(numbers.columns[k].chunks_mut(per_row)) {
                let square = errors.iter().map(|e| e * e).sum::<f64>() / per_row as f64;
                typical.fill(square.sqrt());
                if k == SCALES {
                    let far = typical.iter_mut().zip(errors).filter(|(_, e)| e.abs() > SCALE_ERROR_MAX);
                    far.for_each(|(typical, _)| *typical = 0.0);
                }
            }
        }
        numbers
    }

    /// Adds `of` each number of a gradient.
    pub(super) fn add(&mut self, gradient: &Gradient<f32>, term: impl Fn(f64) -> f64) {
        let Parameters { centers, log_scales, sh, .. } = &gradient.values;
        let columns = [centers.as_flattened(), log_scales.as_flattened(), sh.as_flattened()];
        let rows = gradient.rows.len().max(1);
        for (sum, values) in self.columns.iter_mut().zip(columns) {
            let per_row = values.len() / rows;
            for (row, values) in gradient.rows.iter().zip(values.chunks(per_row.max(1))) {
                let sum = &mut sum[*row as usize * per_row..][..per_row];
                sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += term(f64::from(*value)));
            }
        }
    }

    /// Mean of the values above 0 in each column; 0 if there are none.
    pub(super) fn means(&self) -> [f64; COLUMNS] {
        self.columns.each_ref().map(|column| {
            let positive = column.iter().filter(|x| **x > 0.0);
            let (sum, count) = positive.fold((0.0, 0), |(sum, count), x| (sum + x, count + 1));
            sum / f64::from(count.max(1))
        })
    }

    /// Calls `change` for each number: with its column, its place in it, the number of `field`, and the number of
    /// `other`.
    pub(super) fn for_each_in(
        &self,
        field: &mut Field,
        other: &Field,
        mut change: impl FnMut(usize, usize, &mut f32, f32),
    ) {
        let Field { centers, log_scales, sh, .. } = field;
        let changed = [centers.as_flattened_mut(), log_scales.as_flattened_mut(), sh.as_flattened_mut()];
        for (k, (numbers, others)) in changed.into_iter().zip(columns(other)).enumerate() {
            for (i, (number, other)) in numbers.iter_mut().zip(others).enumerate() {
                change(k, i, number, *other);
            }
        }
    }
}

fn columns(field: &Field) -> [&[f32]; COLUMNS] {
    [field.centers.as_flattened(), field.log_scales.as_flattened(), field.sh.as_flattened()]
}
