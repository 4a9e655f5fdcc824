//! Android: the entry point of the library, and [`System`], what the headset's operating system
//! gives a player and asks of it.
//!
//! Android's NativeActivity loads the library and runs [`entry`] on a thread of its own, which plays
//! until the viewer or the system ends it. What the viewer sees follows from the session's states,
//! which the runtime derives from the activity's; the activity's own events only have to be taken in
//! all the time, because the system waits for that.
//!
//! The folder for files that the owner of the headset can reach is the working directory, so that
//! names of clips and of outputs need no path.

mod entry;
mod intent;
mod system;

pub(super) use system::System;
