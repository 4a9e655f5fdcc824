//! [`DepthMap`]: how far each pixel of a photograph sees.

/// Depths of the pixels of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels; may be another than the photograph's.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Distance along the camera's axis (z, not the length of the ray), row by row from the top
    /// left. In units of the capture once aligned. 0, negative or not finite where it is unknown.
    pub depths: Vec<f32>,
}
