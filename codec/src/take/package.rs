//! [`package`]: reads the head of a clip or of a take.

use crate::{
    Error, Limits, Take, header::contents_of, limits::Budget, preamble::Head, take::head::read_take,
};

/// Reads the head of a clip or of a take without decoding any Gaussian. A clip is a take of one segment.
///
/// `bytes` may be any prefix of a package that holds the whole head.
///
/// # Errors
/// - [`Error::Format`] if the head is damaged or inconsistent, or bytes follow the last section or segment. With
///   [`FormatError::Truncated`](crate::FormatError::Truncated), `bytes` is too short to tell.
/// - [`Error::Version`] if the major version is not [`VERSION_MAJOR`](crate::VERSION_MAJOR).
/// - [`Error::Limits`] if a clip announces more Gaussians than `limits` allow, or a table of sections or segments
///   needs more memory.
pub fn package(bytes: &[u8], limits: &Limits) -> Result<Take, Error> {
    let head = Head::checked(bytes)?;
    let budget = &mut Budget::new(limits);
    if head.is_take() {
        return read_take(&head, bytes.len(), budget);
    }
    contents_of(&head, bytes.len(), limits, budget).map(|contents| Take::from(&contents))
}
