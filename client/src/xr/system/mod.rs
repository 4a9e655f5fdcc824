//! [`System`]: the operating system, as a player needs it. Operating systems differ only here.
//!
//! `request` reads an Android `intent` as a command line, `memory` sets the limits on clips of a headset.

#[cfg(target_os = "android")]
mod android;
#[cfg(not(target_os = "android"))]
mod desktop;
#[cfg(target_os = "android")]
mod intent;
mod memory;
#[cfg(any(target_os = "android", test))]
mod request;

#[cfg(target_os = "android")]
pub(super) use android::System;
#[cfg(not(target_os = "android"))]
pub(super) use desktop::System;
#[cfg(target_os = "android")]
pub(super) use intent::read as read_intent;
pub use memory::clip_limits;
#[cfg(target_os = "android")]
pub(super) use request::{Trust, command_line};
