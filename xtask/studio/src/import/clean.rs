//! Repairs or drops invalid rows, and drops unused columns.
//!
//! A valid row keeps its bits: a quaternion is normalised only if [`Field::check`] would reject it.

use codec::{Field, MOTION_ORDER_MAX, sh_coefficients};

use super::imported::Repairs;

/// Makes a field of raw rows satisfy the invariants of [`Field`], and counts the changes.
///
/// The columns of `raw` have matching lengths and arbitrary values. The result is in normal form: no
/// all-zero top band of SH, no all-zero top power of motion, no all-zero angular rates, and no temporal
/// columns if every row is always on and none moves.
pub(crate) fn clean(mut raw: Field, repairs: &mut Repairs) -> Field {
    let mut usable = Vec::with_capacity(raw.len());
    for row in 0..raw.len() {
        if let Some(reason) = unusable(&raw, row) {
            repairs.drop_rows(reason, 1);
        } else {
            repair_opacity(&mut raw, row, repairs);
            repair_rotation(&mut raw, row, repairs);
            usable.push(row);
        }
    }
    let mut field = if usable.len() == raw.len() { raw } else { raw.select(&usable) };
    leave_out_sh(&mut field);
    leave_out_motion(&mut field);
    debug_assert_eq!(field.check(), Ok(()));
    field
}

/// Reason to drop a row; `None` if it is usable.
fn unusable(raw: &Field, row: usize) -> Option<&'static str> {
    let finite = |vectors: &[[f32; 3]]| vectors.iter().flatten().all(|x| x.is_finite());
    if !finite(&raw.centers[row..=row]) {
        return Some("non-finite centre");
    }
    if !finite(&raw.log_scales[row..=row]) {
        return Some("non-finite scale");
    }
    if !finite(raw.sh_of(row)) {
        return Some("non-finite colour");
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
    let rates = temporal.rotation_rates.as_ref()?;
    (!rates[row].iter().all(|x| x.is_finite())).then_some("non-finite rotation rate")
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
    if (q.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-3 {
        return;
    }
    let norm = q.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    if norm > 0.0 && norm.is_finite() {
        // The length is arbitrary in a file, but rates are relative to it.
        let normalized = |v: [f32; 4]| v.map(|x| (f64::from(x) / norm) as f32);
        *q = normalized(*q);
        if let Some(rate) = rate {
            *rate = normalized(*rate);
            if !rate.iter().all(|x| x.is_finite()) {
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
    field.sh = keep_first(std::mem::take(&mut field.sh), stored, sh_coefficients(degree));
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
    temporal.motion = keep_first(std::mem::take(&mut temporal.motion), stored, usize::from(order));
    temporal.motion_order = order;
    temporal.rotation_rates.take_if(|rates| rates.iter().all(|rate| *rate == [0.0; 4]));
    field.temporal.take_if(|temporal| {
        order == 0 && temporal.rotation_rates.is_none() && temporal.s.iter().all(|s| s.is_infinite())
    });
}

/// The first `keep` of every `group` entries.
fn keep_first(column: Vec<[f32; 3]>, group: usize, keep: usize) -> Vec<[f32; 3]> {
    if keep == group {
        return column;
    }
    column.chunks_exact(group.max(1)).flat_map(|entries| &entries[..keep]).copied().collect()
}
