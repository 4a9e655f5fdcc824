//! [`PanelState`]: what the panel displays.

use crate::clock::Clock;

/// A message for the viewer, of one line or a few.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Notice<'a> {
    /// A remark.
    Note(&'a str),
    /// Work under way.
    Working {
        /// Name of the work.
        text: &'a str,
        /// Completed fraction, 0 to 1, if it is known.
        part: Option<f32>,
    },
    /// A failure.
    Error(&'a str),
}

/// What the panel shows.
#[derive(Clone, Copy, Debug)]
pub struct PanelState<'a> {
    /// Name of the clip.
    pub title: &'a str,
    /// Clock of the clip.
    pub clock: &'a Clock,
    /// Whether the image is the same at all times.
    pub is_static: bool,
    /// Names of the levels of quality, the best one first; may be empty.
    pub qualities: &'a [&'a str],
    /// Number of the level in use.
    pub quality: usize,
    /// Whether that is below the chosen level, because the GPU does not keep up.
    pub lowered: bool,
    /// Whether the room is visible; `None` if the headset cannot show it.
    pub passthrough: Option<bool>,
    /// Whether there is another clip to play.
    pub has_next: bool,
    /// Level of the sound, 0 to 1, and whether it is muted; `None` without sound.
    pub volume: Option<(f32, bool)>,
    /// Parts of a take that play without loading, as seconds (from, to).
    pub buffered: &'a [(f64, f64)],
    /// Rows of names and values.
    pub statistics: &'a [(&'a str, String)],
    /// Message above the console.
    pub notice: Option<Notice<'a>>,
}

impl PanelState<'_> {
    /// Whether there is another instant to go to.
    pub(super) fn has_timeline(&self) -> bool {
        !self.is_static && self.clock.duration_s() > 0.0
    }
}

/// A page above the console.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Page {
    Statistics,
    Buttons,
}
