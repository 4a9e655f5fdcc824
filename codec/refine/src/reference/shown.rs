//! [`shown`]: how much of a field a view shows, which tells a view worth judging by from one of empty
//! space or of a single Gaussian's inside.

use codec::{ALPHA_MIN, Camera, Field};

use super::sort::{self, Order};
use super::splat::{PixelShare, sum_shares};
use super::{FieldPrefix, evaluate_all};
use crate::raster::Tiles;

/// What a view shows of a field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shown {
    /// Fraction of the pixels that any Gaussian covers, 0 to 1.
    pub covered: f64,
    /// Number of Gaussians with a blending weight of at least 1/255 in some pixel.
    pub gaussians: usize,
    /// Largest fraction of the sum of all blending weights that belongs to one Gaussian, 0 to 1.
    pub largest_share: f64,
}

/// Sums of one Gaussian over the pixels.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: f64,
    weight_max: f64,
    /// Pixels whose first Gaussian is this Gaussian.
    pixels: usize,
}

impl Sums {
    fn merge(&mut self, other: &Sums) {
        self.weight += other.weight;
        self.weight_max = self.weight_max.max(other.weight_max);
        self.pixels += other.pixels;
    }
}

/// Measures what `camera` shows of `field` at clip time `t`. `camera` must satisfy [`Camera::check`]; a
/// small picture is enough, as Gaussians thinner than a pixel are blurred to its width.
pub fn shown(field: &Field, camera: &Camera, t: f64) -> Shown {
    let mut splats = evaluate_all(&[FieldPrefix::whole(field)], camera, t);
    sort::sort(&mut splats, Order::Depth);
    let add = |sum: &mut Sums, &PixelShare { weight, transmittance, .. }: &PixelShare| {
        let is_first = transmittance == 1.0;
        sum.merge(&Sums { weight, weight_max: weight, pixels: usize::from(is_first) });
    };
    let sums = sum_shares(&splats, &Tiles::new(&splats, camera.width, camera.height), add, Sums::merge);
    let total: f64 = sums.iter().map(|sum| sum.weight).sum();
    if total == 0.0 {
        return Shown::default();
    }
    let pixels: usize = sums.iter().map(|sum| sum.pixels).sum();
    Shown {
        covered: pixels as f64 / (f64::from(camera.width) * f64::from(camera.height)),
        gaussians: sums.iter().filter(|sum| sum.weight_max >= ALPHA_MIN).count(),
        largest_share: sums.iter().map(|sum| sum.weight).fold(0.0, f64::max) / total,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::balls;

    #[test]
    fn an_opaque_gaussian_hides_what_is_behind_it() {
        let mut centers: Vec<[f32; 3]> =
            (0..60).map(|i| [0.2 * (i % 10) as f32, 0.2 * (i / 10) as f32, 5.0]).collect();
        centers.push([0.0, 0.0, 1.0]);
        let mut field = balls(&centers, 0.1, 0.9);
        let camera = Camera::look_at([0.5, 0.5, -3.0], [0.5, 0.5, 5.0], [0.0, 1.0, 0.0], 0.6, 64, 48);
        let free = shown(&field, &camera, 0.0);
        assert_eq!(free.gaussians, 61);
        assert!(free.largest_share < 0.2, "{free:?}");
        assert!((0.1..0.9).contains(&free.covered), "{free:?}");
        field.log_scales[60] = [2.0; 3];
        field.opacities[60] = 0.999;
        let hidden = shown(&field, &camera, 0.0);
        assert!(hidden.largest_share > 0.95 && hidden.covered == 1.0, "{hidden:?}");
        let away = Camera::look_at([0.0, 0.0, 20.0], [0.0, 0.0, 30.0], [0.0, 1.0, 0.0], 0.6, 64, 48);
        assert_eq!(shown(&field, &away, 0.0), Shown::default());
    }
}
