//! Learned perceptual image patch similarity (LPIPS), its gradient, and the files of its weights.

mod convolution;
mod error;
mod model;
mod network;
#[cfg(test)]
mod tests;

pub use error::LpipsError;
pub use model::Lpips;
pub use network::LpipsNetwork;
