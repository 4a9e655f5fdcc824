//! [`core_box`]: the bounding box of a field without outliers.

use codec::{ALPHA_MIN, Field};
use glam::DVec3;

/// Fraction of the Gaussians at either end of an axis that counts as outliers: fits leave some far from
/// their subject.
const OUTLIERS: f64 = 0.02;

/// Corners of the bounding box of the centres alive at `instants`, without the outermost 2 % at either
/// end of each axis. `None` if no Gaussian is alive.
pub(crate) fn core_box(field: &Field, instants: &[f64]) -> Option<[DVec3; 2]> {
    let alive = |t: f64| {
        let rows = (0..field.len()).filter(move |&row| field.opacity_at(row, t) >= ALPHA_MIN);
        rows.map(move |row| field.position_at(row, t))
    };
    let mut centers: Vec<[f64; 3]> = instants.iter().flat_map(|&t| alive(t)).collect();
    centers.retain(|center| center.iter().all(|x| x.is_finite()));
    let last = centers.len().checked_sub(1)?;
    let outliers = (OUTLIERS * centers.len() as f64) as usize;
    let mut corners = [DVec3::ZERO; 2];
    for axis in 0..3 {
        let mut at = |index: usize| {
            let by_axis = |a: &[f64; 3], b: &[f64; 3]| a[axis].total_cmp(&b[axis]);
            centers.select_nth_unstable_by(index, by_axis).1[axis]
        };
        (corners[0][axis], corners[1][axis]) = (at(outliers), at(last - outliers));
    }
    Some(corners)
}
