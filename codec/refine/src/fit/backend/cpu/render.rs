//! [`render`]: the forward pass, and [`ForwardPass`], the intermediate results that the backward pass
//! starts from.

use pulp::Arch;
use rayon::prelude::*;

use super::bin::Tiles;
use super::project::{Projected, Projection, Splat};
use super::project_backward::project_backward;
use super::rasterize::{DrawnSplat, rasterize};
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
    /// In the order of their rows.
    pub(super) projected: Vec<Projected<T>>,
    /// Front to back.
    pub(super) splats: Vec<Splat<T>>,
    /// Index of each projected Gaussian in `splats`.
    pub(super) places: Vec<u32>,
    pub(super) tiles: Tiles,
    /// Per tile, the splats drawn, front to back.
    pub(super) drawn: Vec<Vec<DrawnSplat>>,
}

/// Renders Gaussians over black. The camera satisfies [`codec::Camera::check`]. No pixel is NaN, for any
/// parameters.
pub fn render<T: Real>(parameters: &Parameters<T>, view: &FrameView) -> ForwardPass<T> {
    let projected = Projection::new(view, parameters).all(parameters);
    let (splats, places) = front_to_back(&projected, parameters);
    let (width, height) = (view.camera.width, view.camera.height);
    let tiles = Tiles::new(&splats, width, height);
    let (image, drawn) = rasterize(Arch::new(), &splats, &tiles, width, height);
    ForwardPass { image, projected, splats, places, tiles, drawn }
}

/// The splats in the order of their depths, those [behind](Parameters::behind) all others after them, and the place of each
/// in that order. Splats of equal depth keep their order.
fn front_to_back<T: Real>(
    projected: &[Projected<T>],
    parameters: &Parameters<T>,
) -> (Vec<Splat<T>>, Vec<u32>) {
    let key = |(i, p): (u32, &Projected<T>)| (parameters.is_behind(p.splat.row as usize), p.splat.depth, i);
    let mut order: Vec<(bool, T, u32)> = (0..).zip(projected).map(key).collect();
    order.par_sort_unstable_by(|(behind, a, i), (other_behind, b, j)| {
        let by_depth = a.partial_cmp(b).expect("depths of splats are finite");
        behind.cmp(other_behind).then(by_depth).then(i.cmp(j))
    });
    let mut places = vec![0; order.len()];
    for (place, (.., index)) in (0..).zip(&order) {
        places[*index as usize] = place;
    }
    (order.iter().map(|(.., index)| projected[*index as usize].splat).collect(), places)
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
        let ForwardPass { image, projected, splats, places, tiles, drawn } = self;
        let d_splats = rasterize_backward(Arch::new(), splats, tiles, drawn, image, d_image);
        project_backward(projected, places, &d_splats, parameters, view, detach_tau)
    }
}
