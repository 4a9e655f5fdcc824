//! [`System`]: the operating system, as a player needs it. Operating systems differ only here.
//!
//! `request` reads an Android intent as a command line.

#[cfg(target_os = "android")]
mod android;
#[cfg(not(target_os = "android"))]
mod desktop;
#[cfg(any(target_os = "android", test))]
mod request;

#[cfg(target_os = "android")]
pub(super) use android::System;
#[cfg(not(target_os = "android"))]
pub(super) use desktop::System;
