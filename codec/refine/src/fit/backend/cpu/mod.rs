//! The back end for the CPU: the forward pass and its gradient.
//!
//! It follows the conventions of [`crate::reference`] and renders the same images, faster: in tiles of
//! 16x16 pixels. A block of 4x4 pixels is a SIMD vector. The backward pass composites a tile a second time,
//! front to back, because the light behind a fragment is the pixel's total minus the running sum.
//!
//! Every sum has a fixed order and no operation is fused with another. Results are therefore the same
//! bit by bit for any number of threads and any vector width; the other back ends are tested against
//! this one.

mod backend;
mod bin;
mod project;
mod project_backward;
mod rasterize;
mod rasterize_backward;
mod render;
mod sh;
#[cfg(test)]
mod tests;

pub use backend::Cpu;
#[cfg(all(test, feature = "gpu"))]
pub(super) use rasterize::{ALPHA_MAX, TRANSMITTANCE_MIN};
pub use render::{ForwardPass, render};
