//! [`Tracking`]: where the eyes are and what the hands do, in the space of the stage.
//!
//! `space` opens the stage, `eye` turns the runtime's poses and angles into views, and `input` reads the hands.

pub(super) mod eye;
pub(super) mod input;
pub(super) mod space;

use openxr as xr;

use crate::headset::interaction::{Hands, Haptics, Pose};
use crate::xr::runtime::EYES;
use crate::xr::runtime::calls::Stopwatch;
use crate::xr::runtime::error::{During, Halt};
use input::Input;
use space::Stage;

/// The tracked space of a session.
pub(in crate::xr) struct Tracking {
    pub(in crate::xr) input: Input,
    pub(in crate::xr) stage: Stage,
    pub(in crate::xr) stopwatch: Stopwatch,
}

/// The viewer at a display time.
pub(in crate::xr) struct Tracked {
    /// `None` while the headset is not tracked.
    pub(in crate::xr) eyes: Option<Eyes>,
    pub(in crate::xr) head: Option<Pose>,
    pub(in crate::xr) hands: Hands,
}

/// Both eyes, left then right.
pub(in crate::xr) struct Eyes {
    pub(in crate::xr) views: [xr::View; 2],
    pub(in crate::xr) poses: [Pose; 2],
}

impl Tracking {
    /// Locates the eyes at display time `display_ns`, and the hands if they are for this program.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn locate(
        &self,
        session: &xr::Session<xr::Vulkan>,
        display_ns: i64,
        has_focus: bool,
    ) -> Result<Tracked, Halt> {
        let time = xr::Time::from_nanos(display_ns);
        let views = self.stopwatch.time(|| self.views(session, time))?;
        let eyes = views.map(|views| Eyes { poses: [0, 1].map(|i: usize| eye::pose(views[i].pose)), views });
        let hands = if has_focus {
            self.stopwatch.time(|| self.input.hands(session, &self.stage.space, time))?
        } else {
            Hands::default()
        };
        Ok(Tracked { head: eyes.as_ref().map(|eyes| eye::head(&eyes.poses)), eyes, hands })
    }

    /// Lets the hands feel `haptics`.
    pub(in crate::xr) fn feel(&self, session: &xr::Session<xr::Vulkan>, haptics: &Haptics) {
        self.stopwatch.time(|| self.input.feel(session, haptics));
    }

    fn views(
        &self,
        session: &xr::Session<xr::Vulkan>,
        time: xr::Time,
    ) -> Result<Option<[xr::View; 2]>, Halt> {
        let (flags, views) = session.locate_views(EYES, time, &self.stage.space).halt("locating the eyes")?;
        let needed = xr::ViewStateFlags::ORIENTATION_VALID | xr::ViewStateFlags::POSITION_VALID;
        Ok(views.try_into().ok().filter(|_| flags.contains(needed)))
    }
}
