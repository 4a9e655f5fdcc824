//! What a fit learns of its cameras: [`Rig`], their clocks, poses, focal lengths and colours.

mod disagreement;
mod numbers;
mod respond;
mod rig;

pub use disagreement::color_disagreement;
#[cfg(any(test, feature = "gpu"))]
pub(super) use numbers::CAMERA_NUMBERS;
pub use numbers::{CameraNumbers, ViewGradient};
pub(super) use respond::{respond, respond_backward};
pub(super) use rig::SeenView;
pub use rig::{Learned, Rig};
