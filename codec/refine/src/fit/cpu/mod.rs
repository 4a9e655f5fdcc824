//! The back end for the CPU: draws Gaussians, and follows the derivatives back.
//!
//! It draws what [`crate::reference`] draws, by the same conventions, but quickly: in tiles of 16x16
//! pixels, of which a row is a vector. Going back, a tile is drawn a second time from the front, as
//! what is behind a fragment is what is left of the pixel.
//!
//! Every sum runs in an order that the scene fixes, and no operation is fused with another. So numbers
//! are the same bit by bit, whatever the number of threads and the width of the vectors: this back end
//! is what others are tested against.

mod backend;
mod bin;
mod project;
mod project_backward;
mod rasterize;
mod rasterize_backward;
mod sh;
#[cfg(test)]
mod tests;

use pulp::Arch;
use rayon::prelude::*;

use super::{Gradient, Parameters, Picture, Real, View};
pub use backend::Cpu;
use bin::Tiles;
#[cfg(all(test, feature = "gpu"))]
pub(super) use project::{BLUR, NEAR};
use project::{Projection, Splat};
#[cfg(all(test, feature = "gpu"))]
pub(super) use rasterize::{ALPHA_MAX, TRANSMITTANCE_MIN};

/// A picture, and what it takes to go back from it.
#[derive(Clone, Debug)]
pub struct Drawing<T> {
    /// The picture.
    pub picture: Picture<T>,
    /// Front to back.
    splats: Vec<Splat<T>>,
    tiles: Tiles,
    /// Of each tile, how many of its splats were drawn until all pixels were finished.
    reached: Vec<u32>,
}

/// Draws Gaussians over black. The camera satisfies [`codec::Camera::check`]; whatever the
/// parameters, no pixel is NaN.
pub fn draw<T: Real>(parameters: &Parameters<T>, view: &View) -> Drawing<T> {
    let mut splats = Projection::new(view).splats(parameters);
    // Stable: splats at one depth keep their order.
    splats.par_sort_by(|a, b| a.depth.partial_cmp(&b.depth).expect("depths of splats are finite"));
    let (width, height) = (view.camera.width, view.camera.height);
    let tiles = Tiles::new(&splats, width, height);
    let (picture, reached) = rasterize::rasterize(Arch::new(), &splats, &tiles, width, height);
    Drawing { picture, splats, tiles, reached }
}

impl<T: Real> Drawing<T> {
    /// The gradient of a loss, given its gradient by the pixels, which are in the order of the picture.
    /// `parameters` and `view` are those that were drawn.
    ///
    /// With `detached`, trajectories and rotations count as if their time did not depend on `tau`: the
    /// windows' centres then move by opacity alone, as in Spacetime Gaussians, and do not compete with
    /// the motion.
    ///
    /// # Panics
    /// If there are not as many pixels in `d_picture` as in the picture.
    pub fn backward(
        &self,
        parameters: &Parameters<T>,
        view: &View,
        d_picture: &[[T; 4]],
        detached: bool,
    ) -> Gradient<T> {
        assert_eq!(d_picture.len(), self.picture.pixels.len(), "a gradient for each pixel");
        let d_splats = rasterize_backward::rasterize_backward(
            Arch::new(),
            &self.splats,
            &self.tiles,
            &self.reached,
            &self.picture,
            d_picture,
        );
        project_backward::project_backward(&self.splats, &d_splats, parameters, view, detached)
    }
}
