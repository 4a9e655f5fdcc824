//! [`core_box`]: where a field is, without its strays.

use codec::{ALPHA_MIN, Field};
use glam::DVec3;

/// Part of the Gaussians, at either end of an axis, that lies outside the core: fits leave strays
/// far from their subject.
const STRAYS: f64 = 0.02;

/// Corners of a box around the centres visible at `instants`, less the outermost 2 % at either
/// end of each axis. `None` if nothing is visible then.
pub(crate) fn core_box(field: &Field, instants: &[f64]) -> Option<[DVec3; 2]> {
    let visible = |t: f64| {
        let rows = (0..field.len()).filter(move |&row| field.opacity_at(row, t) >= ALPHA_MIN);
        rows.map(move |row| field.position_at(row, t))
    };
    let mut centers: Vec<[f64; 3]> = instants.iter().flat_map(|&t| visible(t)).collect();
    centers.retain(|center| center.iter().all(|x| x.is_finite()));
    let last = centers.len().checked_sub(1)?;
    let strays = (STRAYS * centers.len() as f64) as usize;
    let mut corners = [DVec3::ZERO; 2];
    for axis in 0..3 {
        let mut at = |index: usize| {
            let by_axis = |a: &[f64; 3], b: &[f64; 3]| a[axis].total_cmp(&b[axis]);
            centers.select_nth_unstable_by(index, by_axis).1[axis]
        };
        (corners[0][axis], corners[1][axis]) = (at(strays), at(last - strays));
    }
    Some(corners)
}
