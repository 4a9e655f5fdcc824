//! The back end for graphics devices: the stages of the CPU's, as compute shaders.
//!
//! Parameters, Adam's moments and the statistics for capacity control stay on the device between
//! [`load`](super::Backend::load) and [`store`](super::Backend::store). A step uploads a photograph and
//! leaves a few numbers, which the host reads while later steps run:
//!
//! ```text
//! project -> sort by depth -> bin: count, list, sort by tile -> rasterize -> loss
//!   -> rasterize_backward -> project_backward -> sum, adam
//! ```
//!
//! It follows the conventions of the CPU but sums in another order, so results differ in their last
//! digits. On one device they are reproducible, because atomics only count, or mark which threads have a digit. The CPU computes
//! LPIPS: the image is read back and its gradient uploaded.
//!
//! Only the device knows the number of splat-tile pairs of an image. If they exceed the buffers, the step
//! and those behind it change nothing and run again with larger ones.

mod backend;
mod buffers;
mod device;
mod kernels;
mod plan;
mod steps;
mod timer;
mod traffic;
mod transfer;

pub use backend::Gpu;
pub use device::DeviceCounts;
