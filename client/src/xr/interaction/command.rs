//! [`Command`]: what buttons and panel ask for.

use crate::player::Player;

/// Something a person wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Play or pause.
    TogglePlaying,
    /// One captured frame back.
    StepBack,
    /// One captured frame on.
    StepForward,
    /// To this many seconds from the start.
    Seek(f64),
    /// The next slower rate.
    Slower,
    /// The next faster rate.
    Faster,
    /// The rate of life.
    NormalSpeed,
    /// Start over at the end, or not.
    ToggleLoop,
    /// Play the next clip.
    NextClip,
    /// The next better quality.
    Better,
    /// The next faster one.
    Coarser,
    /// See the room behind the clip, or not.
    TogglePassthrough,
    /// Show or hide the statistics.
    ToggleStatistics,
    /// Show or hide what the buttons do.
    ToggleButtons,
    /// Show or hide the panel.
    TogglePanel,
    /// Put clip and panel in front of the viewer, at life size.
    Recentre,
    /// Take the message away.
    Dismiss,
    /// Leave the program.
    Exit,
}

impl Command {
    /// Carries it out if it is for the clock; whether it was.
    pub fn play(self, player: &mut Player) -> bool {
        match self {
            Command::TogglePlaying => player.toggle_playing(),
            Command::StepBack => player.step_back(),
            Command::StepForward => player.step_forward(),
            Command::Seek(position_s) => player.seek(position_s),
            Command::Slower => player.slower(),
            Command::Faster => player.faster(),
            Command::NormalSpeed => player.set_speed(1.0),
            Command::ToggleLoop => player.set_looping(!player.is_looping()),
            _ => return false,
        }
        true
    }
}
