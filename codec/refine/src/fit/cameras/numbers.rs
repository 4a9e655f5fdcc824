//! [`CameraNumbers`]: the numbers of a camera that a fit can learn, in a fixed order.

use std::ops::Range;

use crate::raster::Real;

/// Number of [`CameraNumbers`].
pub(in crate::fit) const CAMERA_NUMBERS: usize = 21;

/// What differs from the calibration of a camera, a gradient with respect to it, or Adam's moments of it; 0 for a
/// camera as calibrated.
pub type CameraNumbers = [f64; CAMERA_NUMBERS];

/// Index of the time in intervals by which its photographs are later.
pub(super) const TIME: usize = 0;
/// A rotation vector in camera axes, in radians, which turns what the camera sees about its centre.
pub(super) const ROTATION: Range<usize> = 1..4;
/// A translation in camera axes of what it sees, in units of the capture.
pub(super) const TRANSLATION: Range<usize> = 4..7;
/// Index of the logarithm of the factor of its focal lengths.
pub(super) const FOCAL: usize = 7;
/// What is added to [`Response::color`](crate::capture::Response::color), row by row.
pub(super) const COLOR: Range<usize> = 8..20;
/// Whether one of [`COLOR`] is the gain or the offset of a channel: what turns its own colour into itself.
pub(super) fn is_gain(number: usize) -> bool {
    let (row, column) = ((number - COLOR.start) / 4, (number - COLOR.start) % 4);
    column == row || column == 3
}

/// Index of what is added to [`Response::vignette`](crate::capture::Response::vignette).
pub(super) const VIGNETTE: usize = 20;

/// Number of those that are a response's: its colours, then its vignette.
pub(in crate::fit) const RESPONSE_NUMBERS: usize = CAMERA_NUMBERS - COLOR.start;

/// The gradient of a loss of one image with respect to the view that it is rendered from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewGradient<T> {
    /// With respect to the time in intervals.
    pub time: T,
    /// With respect to a rotation vector, in camera axes, which turns the scene about the camera's centre.
    pub rotation: [T; 3],
    /// With respect to a translation of the scene in camera axes.
    pub translation: [T; 3],
    /// With respect to the logarithm of a factor of both focal lengths.
    pub log_focal: T,
}

impl<T: Real> ViewGradient<T> {
    /// In the order of [`CameraNumbers`], with the gradient with respect to the response.
    pub(in crate::fit) fn numbers(&self, by_response: &[f64; RESPONSE_NUMBERS]) -> CameraNumbers {
        let mut numbers = [0.0; CAMERA_NUMBERS];
        numbers[TIME] = self.time.to_double();
        numbers[ROTATION].copy_from_slice(&self.rotation.map(T::to_double));
        numbers[TRANSLATION].copy_from_slice(&self.translation.map(T::to_double));
        numbers[FOCAL] = self.log_focal.to_double();
        numbers[COLOR.start..].copy_from_slice(by_response);
        numbers
    }
}
