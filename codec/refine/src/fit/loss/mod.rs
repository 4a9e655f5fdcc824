//! The objective of a fit, with its gradient, and the metrics that it is made of.

mod lpips;
mod objective;
mod psnr;
mod ssim;

pub use lpips::{Lpips, LpipsError, LpipsNetwork};
#[cfg(feature = "gpu")]
pub(super) use objective::{LAMBDA, lpips_loss};
pub(super) use objective::loss;
pub use psnr::subject_psnr;
pub(crate) use ssim::ssim_and_gradient;
