//! The order of Gaussians in a package: layers, static and dynamic rows, and a Morton curve
//! through space.

use crate::{
    Coder, Field,
    morton::interleave,
    time_index::{CELLS, cell_of},
};

/// Largest change of opacity that is drawn as constant: half a step of an 8-bit pixel.
const STATIC_OPACITY: f64 = 0.5 / 255.0;

/// Rows of one layer, in the order in which they are cut into chunks.
pub(crate) struct Layer {
    /// The static Gaussians.
    pub(crate) static_rows: Vec<usize>,
    /// The dynamic Gaussians.
    pub(crate) dynamic_rows: Vec<usize>,
    /// Number of dynamic rows per cell of the time index; counted for the coder `fixed` only.
    pub(crate) cells: [u32; CELLS],
}

/// Cuts a field into layers that end at `ends`, and orders the rows of each.
pub(crate) fn split(field: &Field, ends: &[usize], bounds: [[f32; 3]; 2], coder: Coder) -> Vec<Layer> {
    let mut start = 0;
    let layer = |&end: &usize| {
        let (mut static_rows, mut dynamic_rows): (Vec<_>, Vec<_>) =
            (start..end).partition(|&i| is_static(field, i));
        start = end;
        sort_along_curve(&mut static_rows, bounds, |i| (0, field.centers[i]));
        let mut cells = [0; CELLS];
        match coder {
            Coder::Fixed => {
                sort_along_curve(&mut dynamic_rows, bounds, |i| (cell_of(field, i), field.centers[i]));
                dynamic_rows.iter().for_each(|&i| cells[cell_of(field, i)] += 1);
            }
            // The decoder sorts by cell.
            Coder::Rans => sort_along_curve(&mut dynamic_rows, bounds, |i| (0, midlife_position(field, i))),
        }
        Layer { static_rows, dynamic_rows, cells }
    };
    ends.iter().map(layer).collect()
}

/// All rows of a field along a Morton curve through its bounds.
pub(crate) fn along_curve(field: &Field) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..field.len()).collect();
    sort_along_curve(&mut rows, field.bounds(), |i| (0, field.centers[i]));
    rows
}

/// Whether Gaussian `i` looks the same during the whole clip: it neither moves nor turns, and its
/// opacity falls by at most [`STATIC_OPACITY`].
pub(crate) fn is_static(field: &Field, i: usize) -> bool {
    let Some(temporal) = &field.temporal else {
        return true;
    };
    let tau = f64::from(temporal.tau[i]);
    let largest_distance = tau.abs().max((1.0 - tau).abs());
    let z = largest_distance / f64::from(temporal.s[i]);
    // o (1 - exp(-x)) <= o x: an upper bound without a transcendental function.
    temporal.is_motionless(i) && f64::from(field.opacities[i]) * 0.5 * z * z <= STATIC_OPACITY
}

/// Position of Gaussian `i` halfway through its alive interval.
fn midlife_position(field: &Field, i: usize) -> [f32; 3] {
    match field.alive_interval(i) {
        Some((start, end)) => field.position_at(i, 0.5 * (start + end)).map(|x| x as f32),
        None => field.centers[i],
    }
}

/// Sorts rows by a key, then along a Morton curve through `bounds`, then by importance.
fn sort_along_curve(
    rows: &mut [usize],
    bounds: [[f32; 3]; 2],
    key_and_point: impl Fn(usize) -> (usize, [f32; 3]),
) {
    rows.sort_by_cached_key(|&i| {
        let (key, point) = key_and_point(i);
        (key, morton(point, bounds), i)
    });
}

/// Position on a Morton curve through `bounds`: 21 bits per axis, interleaved.
fn morton(point: [f32; 3], bounds: [[f32; 3]; 2]) -> u64 {
    interleave([0, 1, 2].map(|axis| {
        let (low, high) = (f64::from(bounds[0][axis]), f64::from(bounds[1][axis]));
        // An axis without extent gives 0 / 0: NaN, which becomes 0.
        let position = ((f64::from(point[axis]) - low) / (high - low)).clamp(0.0, 1.0);
        (position * f64::from((1 << 21) - 1)) as u32
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_interleaves_the_axes() {
        let bounds = [[0.0; 3], [2_097_151.0; 3]];
        let mut state = 1u64;
        for _ in 0..1000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let point = [state >> 43, state >> 22 & 0x1f_ffff, state >> 7 & 0x1f_ffff];
            let expected = (0..21).fold(0, |code, bit| {
                (0..3).fold(code, |code, axis| code | (point[axis] >> bit & 1) << (3 * bit + axis))
            });
            assert_eq!(morton(point.map(|x| x as f32), bounds), expected, "{point:?}");
        }
    }

    #[test]
    fn morton_takes_flat_bounds_and_points_outside() {
        assert_eq!(morton([1.0; 3], [[1.0; 3]; 2]), 0);
        assert_eq!(morton([-5.0; 3], [[0.0; 3], [1.0; 3]]), 0);
        assert_eq!(morton([5.0; 3], [[0.0; 3], [1.0; 3]]), (1 << 63) - 1);
    }
}
