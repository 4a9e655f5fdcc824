//! [`frozen()`]: one instant of a moving field, for formats that hold no motion.

use codec::{ALPHA_MIN, Field};

/// The field at clip time `t` as a static one: centres, rotations and opacities of that instant, without
/// Gaussians that are invisible then (opacity below [`ALPHA_MIN`]).
pub fn frozen(field: &Field, t: f64) -> Field {
    let visible: Vec<usize> = (0..field.len()).filter(|&i| field.opacity_at(i, t) >= ALPHA_MIN).collect();
    frozen_rows(field, &visible, t, |_| t)
}

/// These rows with their opacities at clip time `t` and their centres and rotations at clip time `place(row)`.
pub(crate) fn frozen_rows(field: &Field, rows: &[usize], t: f64, place: impl Fn(usize) -> f64) -> Field {
    Field {
        centers: rows.iter().map(|&row| field.position_at(row, place(row)).map(|x| x as f32)).collect(),
        rotations: rows.iter().map(|&row| field.rotation_at(row, place(row)).map(|x| x as f32)).collect(),
        opacities: rows.iter().map(|&row| field.opacity_at(row, t) as f32).collect(),
        temporal: None,
        ..field.select(rows)
    }
}
