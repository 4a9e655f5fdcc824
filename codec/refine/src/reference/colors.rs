//! [`Colors`]: a picture as a linear function of the Gaussians' colours.
//!
//! Blending weights do not depend on colours. A picture is therefore `A x`, where `x` are the colour
//! coefficients and `A` the weights `alpha T` times the spherical harmonics. `A` is too large to store,
//! so its products are computed by drawing: `A x` is a picture, and `A^T` sums a picture over the fragments of each splat.

use codec::{Camera, Field, sh_coefficients};
use pulp::Arch;

use super::sort::{self, Order};
use super::splat::{PixelShare, sum_at, sum_shares, sum_tiles};
use super::{FieldPrefix, evaluate_all};
use crate::image::Image;
use crate::raster::{
    BLOCKS, Grid, LANES, Lanes, Place, Projection, Sink, Splat, SplatBlock, Tiles, basis, pixels_of,
    rasterize, sum_lanes,
};

/// The matrix `A` of one picture.
pub(crate) struct Colors {
    splats: Vec<Splat<f64>>,
    /// Per splat, the spherical harmonics towards the eye.
    bases: Vec<[f64; 16]>,
    tiles: Tiles,
    coefficients: usize,
}

impl Colors {
    /// The matrix of the picture of `field` from `camera` at clip time `t`.
    pub(crate) fn new(field: &Field, camera: &Camera, t: f64) -> Colors {
        let mut splats = evaluate_all(&[FieldPrefix::whole(field)], camera, t);
        sort::sort(&mut splats, Order::Depth);
        let projection = Projection::<f64>::new(camera, field.filter, f64::from(field.near));
        let coefficients = sh_coefficients(field.sh_degree);
        let direction = |row: u32| projection.direction(field.position_at(row as usize, t)).0;
        let bases = splats.iter().map(|splat| basis(direction(splat.row), coefficients)).collect();
        let tiles = Tiles::new(&splats, camera.width, camera.height);
        Colors { splats, bases, tiles, coefficients }
    }

    /// Adds `A^T picture` to `sum`.
    pub(crate) fn add_transposed(&self, picture: &Image, sum: &mut [[f64; 3]]) {
        self.add_gathered(&picture.pixels, sum);
    }

    /// Adds `A^T A x` to `sum`.
    pub(crate) fn add_normal(&self, x: &[[f64; 3]], sum: &mut [[f64; 3]]) {
        let colored = |(splat, basis): (&Splat<f64>, &[f64; 16])| {
            let row_coefficients = &x[splat.row as usize * self.coefficients..][..self.coefficients];
            let mut color = [0.0; 3];
            for (y, c) in basis.iter().zip(row_coefficients) {
                (0..3).for_each(|channel| color[channel] += y * c[channel]);
            }
            Splat { color: masked(color, splat), ..*splat }
        };
        let colored: Vec<Splat<f64>> = self.splats.iter().zip(&self.bases).map(colored).collect();
        self.add_gathered(&rasterize(Arch::new(), &colored, &self.tiles).0, sum);
    }

    /// Adds the diagonal of `A^T A` to `sum`.
    pub(crate) fn add_diagonal(&self, sum: &mut [[f64; 3]]) {
        let add = |sum: &mut f64, share: &PixelShare| *sum += share.weight.powi(2);
        let squares = sum_shares(&self.splats, &self.tiles, add, |a, b| *a += b);
        for ((splat, basis), square) in self.splats.iter().zip(&self.bases).zip(&squares) {
            let row_coefficients = &mut sum[splat.row as usize * self.coefficients..][..self.coefficients];
            for (y, c) in basis.iter().zip(row_coefficients) {
                let add = masked([y * y * square; 3], splat);
                (0..3).for_each(|channel| c[channel] += add[channel]);
            }
        }
    }

    /// Adds `A^T pixels` to `sum`.
    fn add_gathered(&self, pixels: &[[f64; 4]], sum: &mut [[f64; 3]]) {
        let sink = |tile| Gather::new(pixels, self.tiles.corner(tile), self.tiles.size);
        let merge = |a: &mut [f64; 3], b: &[f64; 3]| (0..3).for_each(|channel| a[channel] += b[channel]);
        let per_splat = sum_tiles(&self.splats, &self.tiles, sink, merge);
        for ((splat, basis), gathered) in self.splats.iter().zip(&self.bases).zip(per_splat) {
            let gathered = masked(gathered, splat);
            let row_coefficients = &mut sum[splat.row as usize * self.coefficients..][..self.coefficients];
            for (y, c) in basis.iter().zip(row_coefficients) {
                (0..3).for_each(|channel| c[channel] += y * gathered[channel]);
            }
        }
    }
}

/// Sums the pixels of a tile, times the weights of each splat.
struct Gather {
    /// Red, green and blue of each block.
    blocks: Vec<[Lanes<f64>; 3]>,
    sums: Vec<[f64; 3]>,
}

impl Gather {
    fn new(pixels: &[[f64; 4]], corner: [usize; 2], size: [usize; 2]) -> Gather {
        let mut blocks = vec![[[0.0; LANES]; 3]; BLOCKS];
        for (block, channels) in blocks.iter_mut().enumerate() {
            for (lane, pixel) in pixels_of(block, corner, size) {
                (0..3).for_each(|channel| channels[channel][lane] = pixels[pixel][channel]);
            }
        }
        Gather { blocks, sums: Vec::new() }
    }
}

impl Sink<f64> for Gather {
    type Output = Vec<[f64; 3]>;

    #[inline(always)]
    fn add(
        &mut self,
        place: Place,
        splat: &SplatBlock<f64>,
        grid: &Grid<f64>,
        transmittance: &mut Lanes<f64>,
    ) {
        for slot in place.slots() {
            let mut products = self.blocks[place.block];
            for x in 0..LANES {
                let fragment = splat.fragment(grid, x, transmittance[x]);
                transmittance[x] = fragment.transmittance_behind;
                (0..3).for_each(|channel| products[channel][x] *= fragment.weight);
            }
            let sum = sum_at(&mut self.sums, slot);
            (0..3).for_each(|channel| sum[channel] += sum_lanes(&products[channel]));
        }
    }

    #[inline(always)]
    fn finish(self) -> Vec<[f64; 3]> {
        self.sums
    }
}

/// Zeroes the channels that are clamped: they do not depend on the coefficients.
fn masked(color: [f64; 3], splat: &Splat<f64>) -> [f64; 3] {
    let is_free = |channel: usize| splat.color[channel] > 0.0 && splat.color[channel] < 1.0;
    [0, 1, 2].map(|channel| if is_free(channel) { color[channel] } else { 0.0 })
}
