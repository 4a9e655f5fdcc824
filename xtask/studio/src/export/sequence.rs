//! Frames of a moving field, each a static field with the same rows.
//!
//! Rows that correspond let a reader fit trajectories to them, as the importer of sequences does. So a frame has the
//! Gaussians that are invisible then, too, with their tiny opacities, where they were or will be visible.

use codec::{ALPHA_MIN, Field};

/// The rows that are visible at one of the clip times `times`, ascending.
pub fn rows_of_sequence(field: &Field, times: &[f64]) -> Vec<usize> {
    let is_visible = |&row: &usize| times.iter().any(|&t| field.opacity_at(row, t) >= ALPHA_MIN);
    (0..field.len()).filter(is_visible).collect()
}

/// These rows of the field at clip time `t`, as a static field. The rows are visible at some time.
pub fn frame_of_sequence(field: &Field, rows: &[usize], t: f64) -> Field {
    // A trajectory may lead anywhere while its Gaussian is invisible.
    let place = |row: usize| field.alive_interval(row).map_or(t, |(first, last)| t.clamp(first, last));
    Field {
        centers: rows.iter().map(|&row| field.position_at(row, place(row)).map(|x| x as f32)).collect(),
        rotations: rows.iter().map(|&row| field.rotation_at(row, place(row)).map(|x| x as f32)).collect(),
        opacities: rows.iter().map(|&row| field.opacity_at(row, t) as f32).collect(),
        temporal: None,
        ..field.select(rows)
    }
}
