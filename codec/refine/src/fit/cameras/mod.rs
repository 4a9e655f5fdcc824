//! What a fit learns of its cameras: [`Rig`], their clocks, poses, focal lengths and colours.

mod gains;
mod numbers;
mod respond;
mod rig;

pub use gains::CameraGains;
#[cfg(any(test, feature = "gpu"))]
pub(super) use numbers::CAMERA_NUMBERS;
#[cfg(feature = "gpu")]
pub(super) use numbers::RESPONSE_NUMBERS;
pub use numbers::{CameraNumbers, ViewGradient};
pub(super) use respond::{respond, respond_backward};
pub(super) use rig::SeenView;
pub use rig::{Learned, Rig};
