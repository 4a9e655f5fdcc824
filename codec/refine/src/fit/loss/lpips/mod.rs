//! Learned perceptual image patch similarity (LPIPS), its gradient, and its weights.

mod convolution;
mod error;
mod model;
mod network;
#[cfg(test)]
mod tests;

pub use error::LpipsError;
pub use model::Lpips;
pub use network::{LpipsNetwork, WeightTensor};
