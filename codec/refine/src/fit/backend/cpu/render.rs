//! [`render`]: the forward pass, and [`ForwardPass`], the intermediate results that the backward pass
//! starts from.

use pulp::Arch;
use rayon::prelude::*;

use super::bin::Tiles;
use super::project::{Projection, Splat};
use super::project_backward::project_backward;
use super::rasterize::rasterize;
use super::rasterize_backward::rasterize_backward;
use crate::fit::backend::Gradient;
use crate::fit::parameters::Parameters;
use crate::fit::precision::Real;
use crate::fit::views::{FrameView, RenderedImage};

/// A rendered image with the intermediate results of its forward pass.
#[derive(Clone, Debug)]
pub struct ForwardPass<T> {
    /// The image.
    pub image: RenderedImage<T>,
    /// Front to back.
    pub(super) splats: Vec<Splat<T>>,
    pub(super) tiles: Tiles,
    /// Per tile, the number of splats composited before all its pixels were saturated.
    pub(super) composited: Vec<u32>,
}

/// Renders Gaussians over black. The camera satisfies [`codec::Camera::check`]. No pixel is NaN, for any
/// parameters.
pub fn render<T: Real>(parameters: &Parameters<T>, view: &FrameView) -> ForwardPass<T> {
    let mut splats = Projection::new(view, parameters.filter).splats(parameters);
    // Stable: splats of equal depth keep their order.
    splats.par_sort_by(|a, b| a.depth.partial_cmp(&b.depth).expect("depths of splats are finite"));
    let (width, height) = (view.camera.width, view.camera.height);
    let tiles = Tiles::new(&splats, width, height);
    let (image, composited) = rasterize(Arch::new(), &splats, &tiles, width, height);
    ForwardPass { image, splats, tiles, composited }
}

impl<T: Real> ForwardPass<T> {
    /// Backpropagates `d_image`, the gradient of a loss with respect to the pixels, to the parameters.
    /// `parameters` and `view` are those of the forward pass. For `detach_tau` see
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
        let ForwardPass { image, splats, tiles, composited } = self;
        let d_splats = rasterize_backward(Arch::new(), splats, tiles, composited, image, d_image);
        project_backward(splats, &d_splats, parameters, view, detach_tau)
    }
}
