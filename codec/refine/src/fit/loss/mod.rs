//! The objective of a fit, with its gradient, and the metrics that it is made of.

mod lpips;
mod objective;
mod psnr;
mod ssim;

pub use lpips::{Lpips, LpipsError, LpipsNetwork, WeightTensor};
#[cfg(all(test, feature = "gpu"))]
pub(super) use objective::ALPHA_CHANNELS;
pub(super) use objective::loss;
#[cfg(feature = "gpu")]
pub(super) use objective::{LAMBDA, lpips_loss};
pub use psnr::subject_psnr;
pub(crate) use ssim::ssim_and_gradient;
