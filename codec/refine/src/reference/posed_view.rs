//! [`PosedView`]: a picture to take.

use codec::Camera;

/// A picture to take.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedView {
    /// From where, and how large.
    pub camera: Camera,
    /// When, in clip time.
    pub t: f64,
}
