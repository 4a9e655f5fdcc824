//! [`AnchorFrame`]: the photographs of one frame.

use codec::Camera;

use super::DepthMap;
use crate::fit::Photograph;

/// One frame of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct AnchorFrame {
    /// Number of the frame in the clip, from 0, held-out frames included.
    pub frame: usize,
    /// Time of the frame in intervals since the first, see [`Timeline`](crate::fit::Timeline).
    pub time: f64,
    /// Photographs of the frame.
    pub views: Vec<AnchorView>,
}

/// One camera's photograph of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct AnchorView {
    /// Number of the camera in the capture.
    pub camera_id: usize,
    /// The camera, at the size of the photograph. It satisfies [`Camera::check`].
    pub camera: Camera,
    /// The photograph.
    pub photograph: Photograph,
    /// Depth map of the photograph, for [`DepthSource::Given`](super::DepthSource).
    pub depths: Option<DepthMap>,
}
