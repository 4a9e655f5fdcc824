//! The back end for graphics devices: the stages of the CPU's, as compute shaders.
//!
//! Parameters, Adam's moments and the statistics for capacity control stay on the device between
//! [`load`](super::Backend::load) and [`store`](super::Backend::store). A step uploads a photograph and
//! reads a few numbers back:
//!
//! ```text
//! project -> sort by depth -> bin: count, scan, list, sort by tile -> rasterize -> loss
//!   -> rasterize_backward -> project_backward -> adam
//! ```
//!
//! It follows the conventions of the CPU but sums in another order, so results differ in their last
//! digits. On one device they are reproducible, because only counts are added atomically. The CPU computes
//! LPIPS: the image is read back and its gradient uploaded.
//!
//! Only the device knows the number of splat-tile pairs of an image. If they exceed the buffers, the step
//! changes nothing and runs again with larger ones.

mod backend;
mod buffers;
mod device;
mod kernels;
mod plan;
mod transfer;

pub use backend::Gpu;
