//! Stage `splat`: composites sorted splats into pixels (the paper's `eq:render`), or sums over their fragments.

use pulp::Arch;

use crate::image::Image;
use crate::raster::{
    Grid, LANES, Lanes, Place, Sink, Splat, SplatBlock, Tiles, draw_tiles, rasterize, sum_by_splat,
};

/// Composites `splats`, which are sorted front to back, over black.
pub(crate) fn splat(splats: &[Splat<f64>], width: u32, height: u32) -> Image {
    let (pixels, _) = rasterize(Arch::new(), splats, &Tiles::new(splats, width, height));
    Image { width, height, pixels }
}

/// A splat's contribution to a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelShare {
    /// Index of the splat.
    pub(crate) index: usize,
    /// Blending weight: alpha times transmittance.
    pub(crate) weight: f64,
    /// Transmittance in front of the splat; 1 for the first splat of a pixel, and for no other.
    pub(crate) transmittance: f64,
}

/// A sum per splat over all pixels of `tiles`. `add` adds the contribution to one pixel to the sum of a tile, and `merge`
/// adds the sum of a tile to the total. The result does not depend on the number of threads.
pub(crate) fn sum_shares<S: Clone + Default + Send + Sync>(
    splats: &[Splat<f64>],
    tiles: &Tiles,
    add: impl Fn(&mut S, &PixelShare) + Sync,
    merge: impl Fn(&mut S, &S) + Sync,
) -> Vec<S> {
    sum_tiles(splats, tiles, |_| ShareSums { sums: Vec::new(), add: &add }, merge)
}

/// A sum per splat over the tiles. The sink of a tile returns a summand for each splat that is drawn.
pub(crate) fn sum_tiles<S: Clone + Default + Send + Sync, K: Sink<f64, Output = Vec<S>>>(
    splats: &[Splat<f64>],
    tiles: &Tiles,
    sink: impl Fn(usize) -> K + Sync,
    merge: impl Fn(&mut S, &S) + Sync,
) -> Vec<S> {
    let (by_tile, drawn): (Vec<_>, Vec<_>) = draw_tiles(Arch::new(), splats, tiles, sink).into_iter().unzip();
    sum_by_splat(splats.len(), &drawn, &by_tile, merge)
}

/// The sum at a slot; slots follow one another.
#[inline(always)]
pub(crate) fn sum_at<S: Default>(sums: &mut Vec<S>, slot: usize) -> &mut S {
    if slot == sums.len() {
        sums.push(S::default());
    }
    &mut sums[slot]
}

/// The sums of [`sum_shares`] in a tile.
struct ShareSums<'a, S, F> {
    sums: Vec<S>,
    add: &'a F,
}

impl<S: Default + Send, F: Fn(&mut S, &PixelShare)> Sink<f64> for ShareSums<'_, S, F> {
    type Output = Vec<S>;

    #[inline(always)]
    fn add(
        &mut self,
        place: Place,
        splat: &SplatBlock<f64>,
        grid: &Grid<f64>,
        transmittance: &mut Lanes<f64>,
    ) {
        for (index, slot) in place.run.iter().zip(place.slots()) {
            let before = *transmittance;
            let mut weights = [0.0; LANES];
            for x in 0..LANES {
                let fragment = splat.fragment(grid, x, transmittance[x]);
                transmittance[x] = fragment.transmittance_behind;
                weights[x] = fragment.weight;
            }
            let sum = sum_at(&mut self.sums, slot);
            for (weight, transmittance) in weights.into_iter().zip(before) {
                if weight > 0.0 {
                    (self.add)(sum, &PixelShare { index: *index as usize, weight, transmittance });
                }
            }
        }
    }

    #[inline(always)]
    fn finish(self) -> Vec<S> {
        self.sums
    }
}
