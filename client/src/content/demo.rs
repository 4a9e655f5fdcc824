//! The package of the built-in demo clip.
//!
//! On a desktop it is part of the program. On Android it is an asset of the APK, and the entry point
//! registers the function that reads it.

use std::borrow::Cow;
#[cfg(target_os = "android")]
use std::sync::OnceLock;

use program::Fault;

/// The bytes of the package.
#[cfg(not(target_os = "android"))]
pub(super) fn package() -> Result<Cow<'static, [u8]>, Fault> {
    Ok(Cow::Borrowed(include_bytes!("../../../assets/demo.aarc")))
}

/// Reads the package from where the system keeps it.
#[cfg(target_os = "android")]
type Reader = fn() -> Result<Cow<'static, [u8]>, Fault>;

#[cfg(target_os = "android")]
static READER: OnceLock<Reader> = OnceLock::new();

/// Registers the function that reads the package; later calls change nothing.
#[cfg(target_os = "android")]
pub(crate) fn set_reader(reader: Reader) {
    let _ = READER.set(reader);
}

/// The bytes of the package.
///
/// # Errors
/// [`Fault::Data`] if it cannot be read.
#[cfg(target_os = "android")]
pub(super) fn package() -> Result<Cow<'static, [u8]>, Fault> {
    READER.get().ok_or_else(|| Fault::Data("demo clip: there is none".into()))?()
}
