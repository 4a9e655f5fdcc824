//! [`FrameView`]: the viewpoint that a step renders.

use codec::Camera;

/// A camera at an instant.
#[derive(Clone, Copy, Debug)]
pub struct FrameView<'a> {
    /// The camera; it satisfies [`Camera::check`].
    pub camera: &'a Camera,
    /// Time in intervals since the first frame, see [`Timeline`](crate::fit::Timeline).
    pub time: f64,
}
