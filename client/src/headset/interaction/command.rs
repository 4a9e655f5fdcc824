//! [`Command`]: a wish of the viewer, from a button or the panel.

use crate::clock::Clock;

/// A wish of the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Play or pause.
    TogglePlaying,
    /// One captured frame back.
    StepBack,
    /// One captured frame forward.
    StepForward,
    /// To this many seconds from the start.
    Seek(f64),
    /// The next slower speed.
    Slower,
    /// The next faster speed.
    Faster,
    /// The speed of life.
    NormalSpeed,
    /// Play backwards or forward.
    ToggleReverse,
    /// Turn looping on or off.
    ToggleLoop,
    /// Turn sound off or on.
    ToggleMuted,
    /// Play the next clip.
    NextClip,
    /// The next better quality.
    Better,
    /// The next lower quality.
    Coarser,
    /// Show or hide the room behind the clip.
    TogglePassthrough,
    /// Show or hide the statistics.
    ToggleStatistics,
    /// Show or hide the list of buttons.
    ToggleButtons,
    /// Show or hide the panel.
    TogglePanel,
    /// Put clip, at life size, and panel in front of the viewer.
    Recentre,
    /// Remove the message.
    Dismiss,
    /// Leave the program.
    Exit,
}

impl Command {
    /// Carries the command out if it is for the clock; returns whether it was.
    pub fn play(self, clock: &mut Clock) -> bool {
        match self {
            Command::TogglePlaying => clock.toggle_playing(),
            Command::StepBack => clock.step_back(),
            Command::StepForward => clock.step_forward(),
            Command::Seek(position_s) => clock.seek(position_s),
            Command::Slower => clock.slower(),
            Command::Faster => clock.faster(),
            Command::NormalSpeed => clock.set_speed(1.0),
            Command::ToggleReverse => clock.set_reversed(!clock.is_reversed()),
            Command::ToggleLoop => clock.set_looping(!clock.is_looping()),
            _ => return false,
        }
        true
    }
}
