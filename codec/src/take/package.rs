//! [`package`]: reads the head of a package of either kind.

use crate::{
    Contents, Error, Limits, Take, header::contents_of, limits::Budget, preamble::Head, take::head::read_take,
};

/// The head of a package.
#[derive(Clone, Debug, PartialEq)]
pub enum Package {
    /// An ordinary clip. [`Take::from`] makes it a take of one segment.
    Clip(Contents),
    /// A take of segments.
    Take(Take),
}

/// Reads the head of a clip or of a take without decoding any Gaussian.
///
/// `bytes` may be any prefix of a package that holds the whole head.
///
/// # Errors
/// - [`Error::Format`] if the head is damaged or inconsistent, or bytes follow the last section or segment. With
///   [`FormatError::Truncated`](crate::FormatError::Truncated), `bytes` is too short to tell.
/// - [`Error::Version`] if the major version is not [`VERSION_MAJOR`](crate::VERSION_MAJOR).
/// - [`Error::Limits`] if a clip announces more Gaussians than `limits` allow, or a table of sections or segments
///   needs more memory.
pub fn package(bytes: &[u8], limits: &Limits) -> Result<Package, Error> {
    let head = Head::checked(bytes)?;
    let budget = &mut Budget::new(limits);
    if head.is_take() {
        read_take(&head, bytes.len(), budget).map(Package::Take)
    } else {
        contents_of(&head, bytes.len(), limits, budget).map(Package::Clip)
    }
}
