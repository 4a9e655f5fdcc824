//! [`Colors`]: a picture as a linear function of the Gaussians' colours.
//!
//! Blending weights do not depend on colours. A picture is therefore `A x`, where `x` are the colour
//! coefficients and `A` the weights `alpha T` times the spherical harmonics. `A` is too large to store,
//! so its products are computed by walking over the picture.

use codec::{Camera, Field, sh_coefficients};
use glam::DVec3;

use super::evaluate::Splat;
use super::sh::basis;
use super::sort::{self, Order};
use super::splat::{Fragment, Walk};
use super::{FieldPrefix, evaluate_all};
use crate::image::Image;

/// The matrix `A` of one picture.
pub(crate) struct Colors {
    splats: Vec<Splat>,
    /// Per splat, the spherical harmonics towards the eye.
    bases: Vec<[f64; 16]>,
    walk: Walk,
    coefficients: usize,
}

impl Colors {
    /// The matrix of the picture of `field` from `camera` at clip time `t`.
    pub(crate) fn new(field: &Field, camera: &Camera, t: f64) -> Colors {
        let mut splats = evaluate_all(&[FieldPrefix::whole(field)], camera, t);
        sort::sort(&mut splats, Order::Depth);
        let eye = DVec3::from_array(camera.position());
        let direction = |row| (DVec3::from_array(field.position_at(row, t)) - eye).normalize_or_zero();
        let bases = splats.iter().map(|splat| basis(direction(splat.row))).collect();
        let walk = Walk::new(&splats, camera.width, camera.height);
        Colors { splats, bases, walk, coefficients: sh_coefficients(field.sh_degree) }
    }

    /// Adds `A^T picture` to `sum`.
    pub(crate) fn add_transposed(&self, picture: &Image, sum: &mut [[f64; 3]]) {
        self.add_gathered(sum, |pixel, _| {
            let [r, g, b, _] = picture.pixels[pixel];
            [r, g, b]
        });
    }

    /// Adds `A^T A x` to `sum`.
    pub(crate) fn add_normal(&self, x: &[[f64; 3]], sum: &mut [[f64; 3]]) {
        let colors: Vec<[f64; 3]> = self
            .splats
            .iter()
            .zip(&self.bases)
            .map(|(splat, basis)| {
                let row_coefficients = &x[splat.row * self.coefficients..][..self.coefficients];
                let mut color = [0.0; 3];
                for (y, c) in basis.iter().zip(row_coefficients) {
                    (0..3).for_each(|channel| color[channel] += y * c[channel]);
                }
                masked(color, splat)
            })
            .collect();
        self.add_gathered(sum, |_, fragments| {
            let mut pixel = [0.0; 3];
            for fragment in fragments {
                let color = colors[fragment.index()];
                (0..3).for_each(|channel| pixel[channel] += fragment.weight() * color[channel]);
            }
            pixel
        });
    }

    /// Adds the diagonal of `A^T A` to `sum`.
    pub(crate) fn add_diagonal(&self, sum: &mut [[f64; 3]]) {
        let add = |sum: &mut f64, fragment: &Fragment| *sum += fragment.weight().powi(2);
        let squares = self.walk.sum_of_fragments(add, |a, b| *a += b);
        for ((splat, basis), square) in self.splats.iter().zip(&self.bases).zip(&squares) {
            let row_coefficients = &mut sum[splat.row * self.coefficients..][..self.coefficients];
            for (y, c) in basis.iter().zip(row_coefficients) {
                let add = masked([y * y * square; 3], splat);
                (0..3).for_each(|channel| c[channel] += add[channel]);
            }
        }
    }

    /// Adds `A^T r` to `sum`; `r` computes a pixel from its index and fragments.
    fn add_gathered(&self, sum: &mut [[f64; 3]], r: impl Fn(usize, &[Fragment]) -> [f64; 3] + Sync) {
        let add = |sums: &mut [[f64; 3]], pixel: usize, fragments: &[Fragment]| {
            let r = r(pixel, fragments);
            for fragment in fragments {
                let sum = &mut sums[fragment.slot()];
                (0..3).for_each(|channel| sum[channel] += fragment.weight() * r[channel]);
            }
        };
        let merge = |a: &mut [f64; 3], b: &[f64; 3]| (0..3).for_each(|channel| a[channel] += b[channel]);
        let per_splat = self.walk.sum_per_splat(add, merge);
        for ((splat, basis), gathered) in self.splats.iter().zip(&self.bases).zip(per_splat) {
            let gathered = masked(gathered, splat);
            let row_coefficients = &mut sum[splat.row * self.coefficients..][..self.coefficients];
            for (y, c) in basis.iter().zip(row_coefficients) {
                (0..3).for_each(|channel| c[channel] += y * gathered[channel]);
            }
        }
    }
}

/// Zeroes the channels that are clamped at 0: they do not depend on the coefficients.
fn masked(color: [f64; 3], splat: &Splat) -> [f64; 3] {
    [0, 1, 2].map(|channel| if splat.color[channel] > 0.0 { color[channel] } else { 0.0 })
}
