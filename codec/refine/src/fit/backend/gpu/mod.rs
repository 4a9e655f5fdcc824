//! The back end for graphics devices: the stages of the CPU's, in compute shaders.
//!
//! What is fitted, Adam's moments and what the control of density asks for stay on the device between
//! [`load`](super::Backend::load) and [`store`](super::Backend::store). A step hands over a photograph
//! and gets back a few numbers:
//!
//! ```text
//! project -> sort by depth -> bin: count, sum, list, sort by tile -> rasterize -> loss
//!   -> rasterize_backward -> project_backward -> adam
//! ```
//!
//! It follows the CPU's conventions to the letter, but adds up in another order, so results differ in
//! their last digits. On one device they are the same each time: nothing is added atomically but counts.
//! LPIPS is computed by the CPU: for that the picture
//! comes to it, and the gradient goes back.
//!
//! How many tiles the splats of a picture reach is known on the device alone. Where there is no room for
//! all, nothing is moved, room is made, and the step is taken again.

mod backend;
mod buffers;
mod device;
mod kernels;
mod plan;
mod transfer;

pub use backend::Gpu;
