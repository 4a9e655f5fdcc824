//! [`Beginning`]: how a clip begins to be shown.

/// How a clip begins to be shown.
#[derive(Clone, Copy)]
#[cfg_attr(
    not(any(feature = "window", feature = "xr")),
    allow(dead_code, reason = "a window and a headset begin anywhere, images at the time they show")
)]
pub(crate) struct Beginning<'a> {
    /// Position in seconds, anywhere at all: the clip may be shorter.
    pub(crate) position_s: f64,
    /// Whether playback waits for it.
    pub(crate) is_blocking: bool,
    /// Whether it is not wanted any more: nothing waits for a network then.
    pub(crate) is_overtaken: &'a dyn Fn() -> bool,
}
