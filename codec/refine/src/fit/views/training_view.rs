//! [`TrainingView`]: one sample of the training set.

use codec::Camera;

use super::{FrameView, Photograph};

/// A photograph with its camera and time, as calibrated.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingView {
    /// Number of the camera in the capture.
    pub camera_id: usize,
    /// The camera; its image has the size of the photograph.
    pub camera: Camera,
    /// Time in intervals since the first frame, see [`Timeline`](crate::fit::Timeline).
    pub time: f64,
    /// The photograph.
    pub photograph: Photograph,
}

impl TrainingView {
    /// Viewpoint from which the photograph was taken.
    pub fn view(&self) -> FrameView<'_> {
        FrameView { camera: &self.camera, time: self.time }
    }
}
