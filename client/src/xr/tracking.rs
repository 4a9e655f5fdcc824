//! [`Tracking`]: where the eyes are and what the hands do, in the space of the stage.

use openxr as xr;

use super::calls::Stopwatch;
use super::error::{During, Halt};
use super::eye;
use super::input::Input;
use super::interaction::{Hands, Haptics, Pose};
use super::runtime::EYES;

/// The tracked space of a session.
pub(super) struct Tracking {
    pub(super) input: Input,
    pub(super) stage: xr::Space,
    pub(super) stopwatch: Stopwatch,
}

/// The viewer at a display time.
pub(super) struct Tracked {
    /// `None` while the headset is not tracked.
    pub(super) eyes: Option<Eyes>,
    pub(super) head: Option<Pose>,
    pub(super) hands: Hands,
}

/// Both eyes, left then right.
pub(super) struct Eyes {
    pub(super) views: [xr::View; 2],
    pub(super) poses: [Pose; 2],
}

impl Tracking {
    /// Locates the eyes at display time `display_ns`, and the hands if they are for this program.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn locate(
        &self,
        session: &xr::Session<xr::Vulkan>,
        display_ns: i64,
        has_focus: bool,
    ) -> Result<Tracked, Halt> {
        let time = xr::Time::from_nanos(display_ns);
        let views = self.stopwatch.time(|| self.views(session, time))?;
        let eyes = views.map(|views| Eyes { poses: [0, 1].map(|i: usize| eye::pose(views[i].pose)), views });
        let hands = if has_focus {
            self.stopwatch.time(|| self.input.hands(session, &self.stage, time))?
        } else {
            Hands::default()
        };
        Ok(Tracked { head: eyes.as_ref().map(|eyes| eye::head(&eyes.poses)), eyes, hands })
    }

    /// Lets the hands feel `haptics`.
    pub(super) fn feel(&self, session: &xr::Session<xr::Vulkan>, haptics: &Haptics) {
        self.stopwatch.time(|| self.input.feel(session, haptics));
    }

    fn views(
        &self,
        session: &xr::Session<xr::Vulkan>,
        time: xr::Time,
    ) -> Result<Option<[xr::View; 2]>, Halt> {
        let (flags, views) = session.locate_views(EYES, time, &self.stage).halt("locating the eyes")?;
        let needed = xr::ViewStateFlags::ORIENTATION_VALID | xr::ViewStateFlags::POSITION_VALID;
        Ok(views.try_into().ok().filter(|_| flags.contains(needed)))
    }
}
