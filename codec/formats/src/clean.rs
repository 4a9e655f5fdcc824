//! Repairs or drops rows that are invalid, or too far or large for a package, and drops unused columns.
//!
//! A valid row keeps its bits: a quaternion is normalised only if [`Field::check`] would reject it.

use codec::{Field, MAGNITUDE_MAX, MOTION_ORDER_MAX, sh_coefficients};

use crate::account::Repairs;
use crate::columns::LOG_FLAT;

/// Makes a field of raw rows satisfy the invariants of [`Field`], and counts the changes.
///
/// The columns of `raw` have matching lengths and arbitrary values. The result is in normal form: no
/// all-zero top band of SH, no all-zero top power of motion, no all-zero angular rates, and no temporal
/// columns if every row is always on and none moves.
///
/// Works in place: a large field fits into memory once.
pub(crate) fn clean(mut field: Field, repairs: &mut Repairs) -> Field {
    let mut usable = Vec::with_capacity(field.len());
    for row in 0..field.len() {
        if let Some(reason) = unusable(&field, row) {
            repairs.drop_rows(reason, 1);
        } else {
            repair_scale(&mut field, row, repairs);
            repair_opacity(&mut field, row, repairs);
            repair_rotation(&mut field, row, repairs);
            usable.push(row);
        }
    }
    if usable.len() < field.len() {
        keep_rows(&mut field, &usable);
    }
    leave_out_sh(&mut field);
    leave_out_motion(&mut field);
    debug_assert_eq!(field.check(), Ok(()));
    field
}

/// As [`clean`], for a static field whose rows keep their places: one that would be dropped becomes an invisible one at the
/// origin. Returns the numbers of such rows, ascending, which are not counted.
pub(crate) fn clean_in_place(mut field: Field, repairs: &mut Repairs) -> (Field, Vec<usize>) {
    let lost: Vec<usize> = match field.temporal {
        Some(_) => Vec::new(),
        None => (0..field.len()).filter(|&row| unusable(&field, row).is_some()).collect(),
    };
    let coefficients = sh_coefficients(field.sh_degree);
    for &row in &lost {
        field.centers[row] = [0.0; 3];
        field.rotations[row] = [1.0, 0.0, 0.0, 0.0];
        field.log_scales[row] = [0.0; 3];
        field.opacities[row] = 0.0;
        field.sh[row * coefficients..(row + 1) * coefficients].fill([0.0; 3]);
    }
    (clean(field, repairs), lost)
}

/// Keeps the rows with these ascending indices.
fn keep_rows(field: &mut Field, rows: &[usize]) {
    fn keep<T: Copy>(column: &mut Vec<T>, group: usize, rows: &[usize]) {
        for (to, &from) in rows.iter().enumerate() {
            column.copy_within(from * group..(from + 1) * group, to * group);
        }
        column.truncate(rows.len() * group);
    }
    keep(&mut field.centers, 1, rows);
    keep(&mut field.rotations, 1, rows);
    keep(&mut field.log_scales, 1, rows);
    keep(&mut field.opacities, 1, rows);
    keep(&mut field.sh, sh_coefficients(field.sh_degree), rows);
    if let Some(temporal) = &mut field.temporal {
        keep(&mut temporal.tau, 1, rows);
        keep(&mut temporal.s, 1, rows);
        keep(&mut temporal.motion, usize::from(temporal.motion_order), rows);
        if let Some(rates) = &mut temporal.rotation_rates {
            keep(rates, 1, rows);
        }
    }
}

/// Largest usable logarithm of a scale: variances are `f32`.
const LOG_SCALE_MAX: f32 = 44.0;

/// Logarithm of a scale that is zero along all axes: the smallest positive `f16`, which formats of few bits round down.
const LOG_POINT: f32 = -16.635_532;

/// Reason to drop a row; `None` if it is usable.
fn unusable(raw: &Field, row: usize) -> Option<&'static str> {
    let finite = |vectors: &[[f32; 3]]| vectors.iter().flatten().all(|x| x.is_finite());
    let small = |vectors: &[[f32; 3]]| vectors.iter().flatten().all(|x| x.abs() <= MAGNITUDE_MAX);
    let center = &raw.centers[row..=row];
    if !finite(center) {
        return Some("non-finite centre");
    }
    if !small(center) {
        return Some("centre beyond 1e9 units");
    }
    if !raw.log_scales[row].iter().all(|scale| scale.is_finite() || *scale == f32::NEG_INFINITY) {
        return Some("non-finite scale");
    }
    if raw.log_scales[row].iter().any(|&scale| scale > LOG_SCALE_MAX) {
        return Some("scale beyond 32-bit numbers");
    }
    if !finite(raw.sh_of(row)) {
        return Some("non-finite colour");
    }
    if !small(raw.sh_of(row)) {
        return Some("colour beyond 1e9");
    }
    if raw.opacities[row].is_nan() {
        return Some("non-finite opacity");
    }
    let temporal = raw.temporal.as_ref()?;
    if !temporal.tau[row].is_finite() {
        return Some("non-finite window centre");
    }
    // Also rejects NaN.
    if !matches!(temporal.s[row].partial_cmp(&0.0), Some(std::cmp::Ordering::Greater)) {
        return Some("empty window");
    }
    if !finite(temporal.motion_of(row)) {
        return Some("non-finite motion");
    }
    if !small(temporal.motion_of(row)) {
        return Some("motion beyond 1e9 units");
    }
    let rates = temporal.rotation_rates.as_ref()?;
    (!rates[row].iter().all(|x| x.is_finite())).then_some("non-finite rotation rate")
}

/// Gives axes of no thickness a little: a disc stays a disc in any unit.
fn repair_scale(raw: &mut Field, row: usize, repairs: &mut Repairs) {
    let scales = &mut raw.log_scales[row];
    let (count, sum) =
        scales.iter().filter(|scale| scale.is_finite()).fold((0, 0.0), |(n, sum), x| (n + 1, sum + x));
    if count < 3 {
        let thickness = if count > 0 { sum / count as f32 + LOG_FLAT } else { LOG_POINT };
        scales.iter_mut().filter(|scale| scale.is_infinite()).for_each(|scale| *scale = thickness);
        repairs.repair_rows("zero scale", 1);
    }
}

fn repair_opacity(raw: &mut Field, row: usize, repairs: &mut Repairs) {
    let opacity = &mut raw.opacities[row];
    if !(0.0..=1.0).contains(opacity) {
        *opacity = opacity.clamp(0.0, 1.0);
        repairs.repair_rows("opacity out of range", 1);
    }
}

fn repair_rotation(raw: &mut Field, row: usize, repairs: &mut Repairs) {
    let q = &mut raw.rotations[row];
    let rate = raw.temporal.as_mut().and_then(|t| t.rotation_rates.as_mut()).map(|rates| &mut rates[row]);
    let is_unit = (q.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-3;
    let norm = q.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    if is_unit || norm > 0.0 && norm.is_finite() {
        // The length is arbitrary in a file, but rates are relative to it.
        let normalized = |v: [f32; 4]| if is_unit { v } else { v.map(|x| (f64::from(x) / norm) as f32) };
        *q = normalized(*q);
        if let Some(rate) = rate {
            *rate = normalized(*rate);
            if !rate.iter().all(|x| x.abs() <= MAGNITUDE_MAX) {
                *rate = [0.0; 4];
                repairs.repair_rows("rotation rate far beyond its quaternion", 1);
            }
        }
    } else {
        *q = [1.0, 0.0, 0.0, 0.0];
        if let Some(rate) = rate {
            *rate = [0.0; 4];
        }
        repairs.repair_rows(if norm == 0.0 { "zero quaternion" } else { "non-finite quaternion" }, 1);
    }
}

fn leave_out_sh(field: &mut Field) {
    let stored = sh_coefficients(field.sh_degree);
    let uses = |degree: u8| {
        let below = sh_coefficients(degree - 1);
        field.sh.chunks_exact(stored).any(|sh| sh[below..].iter().any(|c| *c != [0.0; 3]))
    };
    let degree = (1..=field.sh_degree).rev().find(|&degree| uses(degree)).unwrap_or(0);
    keep_first(&mut field.sh, stored, sh_coefficients(degree));
    field.sh_degree = degree;
}

fn leave_out_motion(field: &mut Field) {
    let Some(temporal) = &mut field.temporal else { return };
    let stored = usize::from(temporal.motion_order);
    let uses = |order: u8| {
        let power = usize::from(order) - 1;
        temporal.motion.chunks_exact(stored).any(|v| v[power] != [0.0; 3])
    };
    let order =
        (1..=temporal.motion_order.min(MOTION_ORDER_MAX)).rev().find(|&order| uses(order)).unwrap_or(0);
    keep_first(&mut temporal.motion, stored, usize::from(order));
    temporal.motion_order = order;
    temporal.rotation_rates.take_if(|rates| rates.iter().all(|rate| *rate == [0.0; 4]));
    field.temporal.take_if(|temporal| {
        order == 0 && temporal.rotation_rates.is_none() && temporal.s.iter().all(|s| s.is_infinite())
    });
}

/// Keeps the first `keep` of every `group` entries.
fn keep_first(column: &mut Vec<[f32; 3]>, group: usize, keep: usize) {
    if keep < group {
        let groups = column.len() / group;
        (0..groups).for_each(|i| column.copy_within(i * group..i * group + keep, i * keep));
        column.truncate(groups * keep);
    }
}
