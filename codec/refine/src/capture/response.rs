//! [`Response`]: how a camera turns the colours of a scene into the colours of its photographs.

use serde::{Deserialize, Serialize};

/// An affine transform of colours, and the fall-off of light towards the corners of the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Response {
    /// Rows give red, green and blue of the photograph: factors of the scene's red, green and blue, and what is added.
    /// Colours are display-referred, from 0 to 1.
    pub color: [[f64; 4]; 3],
    /// `v` of the factor `1 + v r^2` of a pixel, where `r` is its distance from the centre of the image, 1 in the corners.
    pub vignette: f64,
}

impl Response {
    /// Photographs have the colours of the scene.
    pub const NEUTRAL: Response =
        Response { color: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]], vignette: 0.0 };

    /// Whether photographs have the colours of the scene.
    pub fn is_neutral(&self) -> bool {
        *self == Response::NEUTRAL
    }
}

impl Default for Response {
    fn default() -> Response {
        Response::NEUTRAL
    }
}
