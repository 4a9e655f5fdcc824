//! Capacity-constrained refinement: moves Gaussians until they look like the photographs.
//!
//! One step, on one photograph, each stage a file with the name that it has on every back end:
//!
//! ```text
//! Parameters -> project -> bin -> rasterize -> loss -> rasterize_backward -> project_backward -> adam
//! ```
//!
//! A [`Backend`] carries steps out, on the CPU or on a device; in between, a [`Fit`] is a value.
//!
//! Time is counted in frames of the capture here, so that a window, a trajectory and their learning
//! rates have sizes near 1; fields count it in clips.

mod adam;
mod backend;
mod bounds;
mod columns;
pub mod cpu;
mod density;
mod extent;
mod floaters;
#[cfg(feature = "gpu")]
pub mod gpu;
mod gradient;
mod loss;
mod lpips;
mod optimize;
mod parameters;
mod picture;
mod rates;
mod real;
mod relocate;
mod run;
mod ssim;
mod view;

use adam::{Moments, adam};
pub use backend::{Backend, DeviceError, Gaussians, Pace};
use bounds::Bounds;
pub use cpu::Cpu;
pub use density::{DensityChange, DensityRule};
use density::{DensityControl, DensityState};
use extent::extent;
pub use gradient::Gradient;
use loss::loss;
pub use lpips::{Lpips, LpipsError, Net};
pub use optimize::{Fit, Settings, Shot, Step, psnr_of_subject};
pub use parameters::{Clock, Parameters};
pub use picture::Picture;
use rates::{Rates, decay};
pub use real::Real;
pub use run::Run;
pub(crate) use ssim::ssim_and_gradient;
pub use view::{Photograph, View};
