//! [`render`]: the forward pass, and [`ForwardPass`], the intermediate results that the backward pass
//! starts from.

use pulp::Arch;
use rayon::prelude::*;

use super::project::{CHUNK, GaussianTrace, Instant};
use super::project_backward::project_backward;
use super::rasterize_backward::rasterize_backward;
use crate::fit::backend::Gradient;
use crate::fit::parameters::Parameters;
use crate::fit::views::{FrameView, RenderedImage};
use crate::raster::{DrawnSplat, Real, SortKey, Splat, Tiles, front_to_back, rasterize};

/// A rendered image with the intermediate results of its forward pass.
#[derive(Clone, Debug)]
pub struct ForwardPass<T> {
    /// The image.
    pub image: RenderedImage<T>,
    /// In the order of their rows, a list for each [`CHUNK`] of rows.
    pub(super) traces: Vec<Vec<GaussianTrace<T>>>,
    /// Front to back.
    pub(super) splats: Vec<Splat<T>>,
    /// Index in `splats` of Gaussian `i` of list `c`, at `c * CHUNK + i`.
    pub(super) places: Vec<u32>,
    pub(super) tiles: Tiles,
    /// Per tile, the splats drawn, front to back.
    pub(super) drawn: Vec<Vec<DrawnSplat>>,
}

/// Renders Gaussians over black. The camera satisfies [`codec::Camera::check`]. No pixel is NaN, for any
/// parameters.
pub fn render<T: Real>(parameters: &Parameters<T>, view: &FrameView) -> ForwardPass<T> {
    let traces = Instant::new(view, parameters).project_all(Arch::new(), parameters);
    // A plate is behind all others.
    let keys = traces.par_iter().enumerate().flat_map_iter(|(chunk, traces)| {
        (chunk * CHUNK..).zip(traces).map(|(index, trace)| {
            let splat = &trace.projected.splat;
            SortKey::new(parameters.is_behind(splat.row as usize), splat.depth, index as u32)
        })
    });
    let order = front_to_back(keys.collect());
    let splat = |index: &u32| {
        let index = *index as usize;
        traces[index / CHUNK][index % CHUNK].projected.splat
    };
    let splats: Vec<Splat<T>> = order.par_iter().map(splat).collect();
    let mut places = vec![0; traces.len() * CHUNK];
    for (place, index) in (0..).zip(order) {
        places[index as usize] = place;
    }
    let (width, height) = (view.camera.width, view.camera.height);
    let tiles = Tiles::new(&splats, width, height);
    let (pixels, drawn) = rasterize(Arch::new(), &splats, &tiles);
    ForwardPass { image: RenderedImage { width, height, pixels }, traces, splats, places, tiles, drawn }
}

impl<T: Real> ForwardPass<T> {
    /// Backpropagates `d_image`, the gradient of a loss with respect to the pixels, to the parameters.
    /// `parameters` and `view` are the inputs of the forward pass. For `detach_tau` see
    /// [`FitSettings`](crate::fit::FitSettings::detach_tau).
    ///
    /// # Panics
    /// If `d_image` and the image differ in length.
    pub fn backward(
        &self,
        parameters: &Parameters<T>,
        view: &FrameView,
        d_image: &[[T; 4]],
        detach_tau: bool,
    ) -> Gradient<T> {
        assert_eq!(d_image.len(), self.image.pixels.len(), "a gradient for each pixel");
        let ForwardPass { image, traces, splats, places, tiles, drawn } = self;
        let d_splats = rasterize_backward(Arch::new(), splats, tiles, drawn, image, d_image);
        project_backward(traces, places, &d_splats, parameters, view, detach_tau)
    }
}
