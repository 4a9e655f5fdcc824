//! [`AnchorError`].

use std::fmt;

/// Error of [`anchor`](super::anchor) and [`scatter`](fn@super::scatter).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AnchorError {
    /// There are no frames.
    NoFrames,
    /// No frame has a camera of [`AnchorSettings::views`](super::AnchorSettings).
    NoViews,
    /// A photograph and its camera differ in size.
    Size {
        /// Number of the frame.
        frame: usize,
        /// Number of the camera.
        camera: usize,
    },
    /// A hull was asked for, but the photographs have no masks.
    NoMasks,
    /// Photographs without masks are to be swept, but all are taken from one place.
    OnePlace,
    /// All masks are empty.
    NoSubject,
    /// A hull was asked for, but only one camera sees the subject.
    OneView,
    /// The silhouettes have no common point.
    NoHull,
    /// No depth map has a valid depth on the subject.
    NoDepths,
    /// Depths are to be scaled by the rig's radius, but the optical axes have no common point.
    NoRig,
    /// The optical axes have no common point to scatter Gaussians around.
    NoCenter,
    /// No pixel is sampled: the number of Gaussians is too small.
    NoRays,
    /// Mirroring was asked for, but the grounding cameras are not on one side.
    NoFront,
}

impl AnchorError {
    /// Whether other frames may still have a surface.
    pub fn is_of_one_frame(&self) -> bool {
        use AnchorError::*;
        matches!(self, NoViews | NoSubject | OneView | NoHull | NoDepths | NoRays)
    }
}

impl fmt::Display for AnchorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AnchorError::NoFrames => "there are no frames to anchor: choose some, or hold out fewer",
            AnchorError::NoViews => "the capture has none of the cameras named to ground the anchor: name others",
            AnchorError::Size { frame, camera } => {
                return write!(
                    f,
                    "the photograph of camera {camera} in frame {frame} and its camera differ in size: scale one"
                );
            }
            AnchorError::NoMasks => {
                "the photographs have no masks, which a visual hull needs: give masks or depth maps"
            }
            AnchorError::OnePlace => {
                "the photographs have no masks and are all taken from one place: give masks, depth maps or more cameras"
            }
            AnchorError::NoSubject => "no mask shows a subject: check the masks",
            AnchorError::OneView => {
                "a visual hull needs two cameras or more that see the subject: give more, or depth maps"
            }
            AnchorError::NoHull => {
                "the masks have no common point, so the visual hull is empty: check cameras and masks"
            }
            AnchorError::NoDepths => {
                "no depth map has a depth on the subject: name them as the photographs, with depths above 0"
            }
            AnchorError::NoRig => {
                "the cameras do not look at one point, so depths cannot be scaled by their distance from it: \
                 give depths in units of the capture or masks to align them to"
            }
            AnchorError::NoCenter => {
                "the cameras do not look at one point, so there is no place to start from: give masks or depth maps"
            }
            AnchorError::NoRays => "no pixel of the subject gets a Gaussian: raise the number of Gaussians",
            AnchorError::NoFront => {
                "mirroring needs cameras on one side: name the frontal ones or turn mirroring off"
            }
        })
    }
}

impl std::error::Error for AnchorError {}
