//! [`LpipsError`]: why LPIPS refuses weights or an image.

use std::fmt;

/// Why LPIPS cannot be computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LpipsError {
    /// A tensor is missing.
    Missing(String),
    /// The shape of the first tensor fits neither network.
    Network(Vec<usize>),
    /// A tensor has the wrong shape.
    Shape {
        /// Name of the tensor.
        tensor: String,
        /// Shape in the network.
        expected: Vec<usize>,
        /// Shape in the file.
        found: Vec<usize>,
    },
    /// A number of a tensor is not finite.
    NotFinite(String),
    /// An image is smaller than the network accepts.
    TooSmall {
        /// Width and height of the image.
        size: [usize; 2],
        /// Smallest width and height that the network accepts.
        smallest: usize,
    },
}

impl fmt::Display for LpipsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LpipsError::Missing(tensor) => write!(f, "the LPIPS weights lack the tensor {tensor}"),
            LpipsError::Network(found) => write!(
                f,
                "the LPIPS weights have a tensor features.0.weight of shape {found:?}: \
                 AlexNet has [64, 3, 11, 11], VGG16 [64, 3, 3, 3]"
            ),
            LpipsError::Shape { tensor, expected, found } => {
                write!(
                    f,
                    "the tensor {tensor} of the LPIPS weights has shape {found:?} instead of {expected:?}"
                )
            }
            LpipsError::NotFinite(tensor) => {
                write!(f, "the tensor {tensor} of the LPIPS weights holds a number that is not finite")
            }
            LpipsError::TooSmall { size: [width, height], smallest } => {
                write!(f, "LPIPS needs images of at least {smallest}x{smallest} pixels, not {width}x{height}")
            }
        }
    }
}

impl std::error::Error for LpipsError {}
