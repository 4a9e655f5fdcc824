//! [`correspond`]: whether the rows of two frames are the same Gaussians in the same order.
//!
//! A Gaussian keeps its colour and size from one frame to the next, and does not go far. So a row resembles the row of
//! the same number more than its neighbours or a distant one, unless the order is another: then it resembles each of
//! them as often.

use codec::{Field, SH_C0};

/// Most rows that are compared.
const ROWS_MAX: usize = 4096;

/// Fraction of the rows that must resemble their own row most. One third does by chance.
const SHARE_MIN: f64 = 0.8;

/// Whether the rows of two frames of the same length, whose content has this `size`, correspond. Rows that `is_lost` are not
/// compared.
pub(super) fn correspond(a: &Field, b: &Field, size: f64, is_lost: impl Fn(usize) -> bool) -> bool {
    let rows = a.len();
    if rows != b.len() {
        return false;
    }
    let step = rows.div_ceil(ROWS_MAX).max(1);
    let resembles_its_own = |&row: &usize| {
        let own = distance(a, row, b, row, size);
        [1, rows / 2, rows - 1].iter().all(|offset| own <= distance(a, row, b, (row + offset) % rows, size))
    };
    let compared: Vec<usize> = (0..rows).step_by(step).filter(|&row| !is_lost(row)).collect();
    let alike = compared.iter().filter(|row| resembles_its_own(row)).count();
    !compared.is_empty() && alike as f64 >= SHARE_MIN * compared.len() as f64
}

/// Squared difference of two rows: positions by the size of the content, sizes and colours.
fn distance(a: &Field, i: usize, b: &Field, j: usize, size: f64) -> f64 {
    let square = |x: [f32; 3], y: [f32; 3]| (0..3).map(|k| f64::from(x[k] - y[k]).powi(2)).sum::<f64>();
    let positions = square(a.centers[i], b.centers[j]) / (size * size);
    let colors = SH_C0 * SH_C0 * square(a.sh_of(i)[0], b.sh_of(j)[0]);
    positions + colors + square(a.log_scales[i], b.log_scales[j])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::fitted::size_of;

    /// Rows on a spiral whose colours flicker, the last one far away.
    fn frame(seed: usize, farthest: f32) -> Field {
        let rows = 300;
        let at = |row: usize| {
            let (sin, cos) = (0.7 * row as f32).sin_cos();
            [sin, 0.01 * row as f32, cos]
        };
        let mut centers: Vec<[f32; 3]> = (0..rows).map(at).collect();
        centers[rows - 1] = [farthest; 3];
        Field {
            centers,
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows],
            log_scales: vec![[-3.0; 3]; rows],
            opacities: vec![0.9; rows],
            sh: (0..rows)
                .map(|row| [0.03 * ((row * 7919 + seed * 104_729) % 101) as f32 / 101.0; 3])
                .collect(),
            ..Field::default()
        }
    }

    #[test]
    fn a_row_far_away_leaves_the_others_where_they_are() {
        for farthest in [1.0, 1e3, 1e9] {
            let [a, b] = [1, 2].map(|seed| frame(seed, farthest));
            let size = size_of(&a);
            assert!(correspond(&a, &b, size, |_| false), "{farthest}");
            let turned: Vec<usize> = (0..a.len()).map(|row| (row + 1) % a.len()).collect();
            assert!(!correspond(&a, &b.select(&turned), size, |_| false), "{farthest}");
        }
    }
}
