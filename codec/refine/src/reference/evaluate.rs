//! Stage `evaluate`: evaluates a Gaussian at the instant and projects it into the image.

use codec::{Camera, Field};
use rayon::prelude::*;

use super::alive::Alive;
use crate::raster::{Projection, Splat};

/// Projects the `alive` rows of `field` in order. Skips rows that are faded near the eye, rows without a
/// finite footprint, and rows that compensation makes invisible.
pub(crate) fn evaluate(field: &Field, alive: &[Alive], camera: &Camera, t: f64) -> Vec<Splat<f64>> {
    let projection = Projection::new(camera, field.filter, f64::from(field.near));
    let splat = |&Alive { row, opacity }: &Alive| {
        let center = projection.center(field.position_at(row, t), opacity)?;
        let scales = field.log_scales[row].map(|scale| libm::exp(f64::from(scale)));
        let rotation = field.rotation_at(row, t);
        Some(projection.project(row as u32, center, rotation, scales, field.sh_of(row))?.splat)
    };
    alive.par_iter().filter_map(splat).collect()
}
