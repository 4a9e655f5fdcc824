//! [`contributions`]: how much of a picture is due to each Gaussian.
//!
//! A pixel is a sum of colours with the weights `alpha T`, `T` being the transmittance in front of
//! the fragment. These weights, summed over the pixels, tell what a picture loses with a Gaussian
//! and how finely it has to be coded.

use codec::{Camera, Field};

use super::sort::{self, Order};
use super::splat::{Fragment, Walk};
use super::{FieldPrefix, evaluate_parts};

/// What one Gaussian contributes to one picture, or to several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contribution {
    /// Sum of `alpha T` over the pixels: the derivative of the sum of all pixels by the Gaussian's
    /// colour.
    pub weight: f64,
    /// Sum of `(alpha T)^2` over the pixels: squared error of the picture per squared error of the
    /// colour.
    pub weight_squared: f64,
    /// Largest `alpha T` of a pixel, in `[0, 1]`.
    pub weight_max: f64,
    /// Sum of `o T` over the pixels that the Gaussian reaches, `o` being its opacity at the
    /// instant: LightGaussian's count of hits.
    pub hits: f64,
}

impl Contribution {
    /// Adds what the Gaussian contributes to other pixels.
    pub fn merge(&mut self, other: &Contribution) {
        self.weight += other.weight;
        self.weight_squared += other.weight_squared;
        self.weight_max = self.weight_max.max(other.weight_max);
        self.hits += other.hits;
    }
}

/// What each row of `field` contributes to its picture from `camera` at clip time `t`.
///
/// The numbers do not depend on the number of threads: sums run over the rows of tiles from top
/// to bottom. `camera` must satisfy [`Camera::check`].
pub fn contributions(field: &Field, camera: &Camera, t: f64, order: Order) -> Vec<Contribution> {
    let mut splats = evaluate_parts(&[FieldPrefix { field, rows: field.len() }], camera, t);
    sort::sort(&mut splats, order);
    let walk = Walk::new(&splats, camera.width, camera.height);
    let add = |sums: &mut [Contribution], _, fragments: &[Fragment]| {
        for fragment in fragments {
            let weight = fragment.weight();
            sums[fragment.index].merge(&Contribution {
                weight,
                weight_squared: weight * weight,
                weight_max: weight,
                hits: splats[fragment.index].opacity * fragment.transmittance,
            });
        }
    };
    let mut rows = vec![Contribution::default(); field.len()];
    for (splat, contribution) in splats.iter().zip(walk.sum_per_splat(add, Contribution::merge)) {
        rows[splat.row] = contribution;
    }
    rows
}
