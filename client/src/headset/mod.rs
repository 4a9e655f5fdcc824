//! What a viewer in a headset sees and does, whatever the runtime: nothing here names OpenXR.
//!
//! `show` is the clip on display: it moves the clip by the hands (`interaction`), paints the `panel`, and chooses the
//! quality by the times of frames (`pacing`).

pub mod interaction;
mod notify;
pub(crate) mod pacing;
pub mod panel;
pub(crate) mod show;

pub(crate) use notify::notify;
