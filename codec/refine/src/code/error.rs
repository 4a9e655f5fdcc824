//! [`CodeError`]: why a field has no package.

use codec::{EncodeError, Error};

use crate::fit::DeviceError;

/// Error of [`code`](super::code).
#[derive(Debug)]
pub enum CodeError {
    /// The field cannot be packaged.
    Encode(EncodeError),
    /// The package cannot be decoded.
    Decode(Error),
    /// The graphics device of joint rounding failed.
    Device(DeviceError),
}
