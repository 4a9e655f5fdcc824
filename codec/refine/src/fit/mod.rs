//! Capacity-constrained refinement: fits a 4D Gaussian field to photographs by gradient descent.
//!
//! A step renders one training view, compares it with its photograph and moves the Gaussians that are
//! visible in it. Each stage has a file of that name in every back end:
//!
//! ```text
//! Parameters -> project -> bin -> rasterize -> loss -> rasterize_backward -> project_backward -> adam
//! ```
//!
//! One folder per purpose; each uses only those above it:
//!
//! - `parameters`: what is optimised, its bounds, its unit of time
//! - `views`: cameras, photographs and rendered images
//! - `cameras`: [`Rig`], what is learned of the cameras
//! - `loss`: the objective and the metrics that it is made of
//! - `optimizer`: Adam, its moments and the learning rates
//! - `density`: capacity control, that is densification, pruning, relocation, the floater filter
//! - `backend`: [`Backend`] on the CPU and on a graphics device
//! - `training`: [`Fit`], a fit as a value, and [`Run`], the optimisation loop
//!
//! The unit of time in here is the interval between the photographs of a camera ([`Timeline`]), so that
//! windows, trajectories and their learning rates have magnitudes near 1 and mean the same for any frame rate
//! and holdout; in a [`codec::Field`] it is the clip.

mod backend;
mod cameras;
mod density;
#[cfg(test)]
pub(crate) mod fixtures;
mod loss;
mod optimizer;
mod parameters;
mod training;
mod views;

pub use crate::raster::Real;
#[cfg(feature = "gpu")]
pub use backend::gpu;
pub use backend::{
    Backend, DeviceError, Gradient, PixelGradients, StepConfig, StepReport, TrainingState, cpu,
};
pub use cameras::{CameraGains, CameraNumbers, Learned, Rig, ViewGradient};
pub use cpu::Cpu;
pub use density::{DensityChange, DensityRule};
pub(crate) use loss::ssim_and_gradient;
pub use loss::{Lpips, LpipsError, LpipsNetwork, WeightTensor, subject_psnr};
pub use parameters::{Carried, Parameters, Timeline};
pub use training::{FRAGMENT_WEIGHT, Fit, FitSettings, Run};
pub use views::{FrameView, Photograph, RenderedImage, TrainingView};
