//! [`Target`]: a place where clips are played, with the runs that it plays and what they measure.

use std::path::Path;

use program::Fault;

use super::clocks::Clocks;

/// A run of the player.
pub(super) struct Run<'a> {
    pub(super) clip: &'a Path,
    /// Where the viewer stands, by the player's option without its dashes.
    pub(super) distance: &'static str,
    pub(super) seconds: f64,
}

/// What a run measured.
pub(super) struct Played {
    /// The JSON of the player's `--stats`.
    pub(super) stats: Vec<u8>,
    /// Clocks, where the runtime logs them.
    pub(super) clocks: Option<Clocks>,
}

/// A place where clips are played.
pub(super) trait Target {
    /// Plays a clip to the end of the run.
    ///
    /// # Errors
    /// [`Fault::Device`] if the headset is gone or the player failed.
    fn play(&self, run: &Run<'_>) -> Result<Played, Fault>;
}
