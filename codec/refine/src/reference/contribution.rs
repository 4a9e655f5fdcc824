//! [`contributions`]: the blending weights of each Gaussian in a picture.
//!
//! A pixel is a sum of colours with weights `alpha T`, where `T` is the transmittance in front of the
//! fragment. Sums of these weights rank Gaussians.

use codec::{Camera, Field};

use super::coverage::{Radius, fragments};
use super::sort::{self, Order};
use super::splat::{PixelShare, sum_shares};
use super::{FieldPrefix, evaluate_all};
use crate::raster::Tiles;

/// Contribution of one Gaussian to one or several pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contribution {
    /// Sum of `alpha T` over the pixels: the derivative of the sum of all pixels with respect to the
    /// Gaussian's colour.
    pub weight: f64,
    /// Largest `alpha T` of a pixel, 0 to 1.
    pub weight_max: f64,
    /// Sum of `o T` over the pixels that the Gaussian covers, where `o` is its opacity at the instant:
    /// LightGaussian's hit count.
    pub hits: f64,
    /// Pixel centres of the image inside the Gaussian's quad, hidden or not: what it costs a player.
    pub fragments: f64,
}

impl Contribution {
    /// Adds the contribution to other pixels.
    pub fn merge(&mut self, other: &Contribution) {
        self.weight += other.weight;
        self.weight_max = self.weight_max.max(other.weight_max);
        self.hits += other.hits;
        self.fragments += other.fragments;
    }
}

/// Contribution of each row of `field` to its picture from `camera` at clip time `t`. `camera` must satisfy
/// [`Camera::check`].
///
/// The result does not depend on the number of threads: tiles are summed in their order.
pub fn contributions(field: &Field, camera: &Camera, t: f64, order: Order) -> Vec<Contribution> {
    let mut splats = evaluate_all(&[FieldPrefix::whole(field)], camera, t);
    sort::sort(&mut splats, order);
    let add = |sum: &mut Contribution, share: &PixelShare| {
        let PixelShare { index, weight, transmittance } = *share;
        sum.merge(&Contribution {
            weight,
            weight_max: weight,
            hits: splats[index].opacity * transmittance,
            fragments: 0.0,
        });
    };
    let tiles = Tiles::new(&splats, camera.width, camera.height);
    let sums = sum_shares(&splats, &tiles, add, Contribution::merge);
    let mut rows = vec![Contribution::default(); field.len()];
    for (splat, contribution) in splats.iter().zip(sums) {
        let fragments = fragments(splat, Radius::Exact, camera.width, camera.height) as f64;
        rows[splat.row as usize] = Contribution { fragments, ..contribution };
    }
    rows
}
