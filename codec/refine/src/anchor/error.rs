//! [`AnchorError`]: why there is no anchor.

use std::fmt;

/// Why there is no anchor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AnchorError {
    /// There are no frames.
    NoFrames,
    /// None of the views that are to put Gaussians on their rays is there.
    NoViews,
    /// A photograph is not as large as its camera says.
    Size {
        /// Number of the frame.
        frame: usize,
        /// Number of the camera.
        camera: usize,
    },
    /// A hull of photographs without masks.
    NoMasks,
    /// All masks are empty.
    NoSubject,
    /// A hull of one mask.
    OneView,
    /// The silhouettes have no point in common.
    NoHull,
    /// No depth map holds a depth.
    NoDepths,
    /// Depths to be scaled by a rig that has no radius.
    NoRig,
    /// Gaussians to be put where the cameras look, but they do not look at one point.
    NoMiddle,
    /// Gaussians to be put on rays, but there is none for them, or none of them is asked for.
    NoRays,
    /// A mirror without a side that is the front.
    NoFront,
}

impl AnchorError {
    /// Whether other frames may do better.
    pub(super) fn is_of_one_frame(&self) -> bool {
        use AnchorError::*;
        matches!(self, NoViews | NoSubject | OneView | NoHull | NoDepths)
    }
}

impl fmt::Display for AnchorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AnchorError::NoFrames => "there are no frames to anchor",
            AnchorError::NoViews => "none of the cameras that are to ground the anchor is in the capture",
            AnchorError::Size { frame, camera } => {
                return write!(
                    f,
                    "the photograph of camera {camera} in frame {frame} is not as large as its camera"
                );
            }
            AnchorError::NoMasks => {
                "the photographs have no masks, so there is no visual hull: give masks or depth maps"
            }
            AnchorError::NoSubject => "no mask shows a subject: check the masks",
            AnchorError::OneView => {
                "a visual hull takes two cameras or more that see the subject: give more or depth maps"
            }
            AnchorError::NoHull => {
                "the masks have no point in common, so there is no visual hull: check cameras and masks"
            }
            AnchorError::NoDepths => {
                "no depth map holds a depth for the subject: all are missing, 0 or not finite"
            }
            AnchorError::NoRig => {
                "the cameras do not look at one point, so depths cannot be scaled by their distance from it: \
                 give depths in units of the capture or masks to align them to"
            }
            AnchorError::NoMiddle => "the cameras do not look at one point, so nobody knows where to start",
            AnchorError::NoRays => "no pixel of the subject gets a Gaussian: ask for more of them",
            AnchorError::NoFront => {
                "the back side is mirrored only behind cameras on one side: name the frontal ones or \
                 turn mirroring off"
            }
        })
    }
}

impl std::error::Error for AnchorError {}
