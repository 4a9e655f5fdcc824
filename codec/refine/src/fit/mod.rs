//! Capacity-constrained refinement: moves Gaussians until they look like the photographs.
//!
//! One step, on one photograph, each stage a file with the name that it has on every back end:
//!
//!     Parameters -> project -> bin -> rasterize -> loss -> rasterize_backward -> project_backward -> adam
//!
//! Time is counted in frames of the capture here, so that a window, a trajectory and their learning
//! rates have sizes near 1; fields count it in clips.

pub mod cpu;
mod gradient;
mod parameters;
mod picture;
mod real;
mod view;

pub use gradient::Gradient;
pub use parameters::{Clock, Parameters};
pub use picture::Picture;
pub use real::Real;
pub use view::{Photograph, View};
