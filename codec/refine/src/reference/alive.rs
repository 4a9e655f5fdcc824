//! Stage `alive`: selects the Gaussians that are alive at an instant.
//!
//! Players query the time index first; the reference tests every row.

use codec::{ALPHA_MIN, Field};
use rayon::prelude::*;

/// An alive row and its opacity at the instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Alive {
    pub(crate) row: usize,
    pub(crate) opacity: f64,
}

/// The first `rows` rows of `field` whose temporal opacity at clip time `t` reaches
/// [`ALPHA_MIN`], in row order.
pub(crate) fn alive(field: &Field, rows: usize, t: f64) -> Vec<Alive> {
    let all = (0..rows).into_par_iter().map(|row| Alive { row, opacity: field.opacity_at(row, t) });
    all.filter(|alive| alive.opacity >= ALPHA_MIN).collect()
}
