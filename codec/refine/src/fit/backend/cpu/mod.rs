//! The back end for the CPU: the forward pass and its gradient.
//!
//! The forward pass is the rasteriser of [`crate::reference`] in f32. The backward pass composites a tile a second time,
//! front to back, because the light behind a fragment is the pixel's total minus the running sum.
//!
//! Results are the same bit by bit for any number of threads and any vector width; the other back ends are tested
//! against this one.

mod backend;
mod project;
mod project_backward;
mod rasterize_backward;
mod render;
#[cfg(test)]
mod tests;

pub use backend::Cpu;
pub use render::{ForwardPass, render};
