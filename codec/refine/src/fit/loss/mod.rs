//! The objective of a fit, with its gradient, and the metrics that it is made of.

mod lpips;
mod objective;
mod psnr;
mod ssim;

pub use lpips::{Lpips, LpipsError, LpipsNetwork, WeightTensor};
pub(super) use objective::loss;
#[cfg(feature = "gpu")]
pub(super) use objective::{LAMBDA, alpha_channels, lpips_loss};
pub use psnr::subject_psnr;
pub(crate) use ssim::ssim_and_gradient;
