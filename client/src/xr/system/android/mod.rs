//! Android: the entry point of the library, and [`System`], the headset's operating system.
//!
//! Android's NativeActivity loads the library and runs [`entry`] on a thread of its own, which plays
//! until the viewer or the system ends it. The runtime derives the session's states from the activity's, so
//! that only the session decides what the viewer sees; the activity's own events must still be handled
//! promptly, because the system waits for that.
//!
//! The working directory is the folder that the owner of the headset can reach over USB, so that names of
//! clips and outputs need no path.

mod entry;
mod intent;
mod system;

pub(in crate::xr) use system::System;
