//! [`DeviceError`]: why a graphics device cannot go on.

use std::fmt;

/// A failure of the graphics device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceError {
    /// There is no usable device; the message says why.
    Missing(String),
    /// A buffer would be larger than the device allows.
    TooLarge {
        /// Name of the device.
        device: String,
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the buffer in bytes.
        bytes: u64,
        /// Largest buffer of the device in bytes.
        limit: u64,
    },
    /// The device is out of memory.
    Memory {
        /// Name of the device.
        device: String,
        /// Contents of the buffer that did not fit.
        what: &'static str,
    },
    /// The device stopped working.
    Lost {
        /// Name of the device.
        device: String,
        /// Message of the driver.
        message: String,
    },
}

impl fmt::Display for DeviceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DeviceError::Missing(message) => f.write_str(message),
            DeviceError::TooLarge { device, what, bytes, limit } => write!(
                f,
                "graphics device {device}: no buffer of {} MB for {what}, the largest is {} MB; \
                 use fewer Gaussians or smaller photographs",
                bytes.div_ceil(1_000_000),
                limit / 1_000_000
            ),
            DeviceError::Memory { device, what } => {
                write!(f, "graphics device {device}: out of memory for {what}")
            }
            DeviceError::Lost { device, message } => write!(f, "graphics device {device}: {message}"),
        }
    }
}

impl std::error::Error for DeviceError {}
