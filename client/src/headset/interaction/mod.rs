//! [`Interaction`]: turns hands into the place of the clip, commands and haptics. It knows neither runtime nor
//! GPU.
//!
//! A frame has this order. The panel comes before the clip, because a hand that points at the panel does not
//! mean the clip:
//!
//! 1. [`Interaction::take`] the hands of the frame;
//! 2. the panel's `point` with [`Interaction::inputs`] says which hands are on it;
//! 3. [`Interaction::update`] moves the clip and appends commands;
//! 4. carry the commands out: [`Command::play`] those for the clock, [`Interaction::recentre`] for
//!    [`Command::Recentre`].

mod command;
mod grab;
mod hands;
mod haptics;
mod inputs;
mod placement;
mod playback;
#[cfg(test)]
pub(super) mod random;
mod stick;
mod store;

pub use command::Command;
pub use hands::{Button, Hand, Hands, Pose, Side};
pub use haptics::{Haptics, Pulse};
pub use inputs::Inputs;
pub use placement::{Placement, SCALE_RANGE, Similarity, SpaceChange};
pub use playback::{BUTTONS, Binding, GESTURES};
pub use store::PlacementStore;

use grab::Grab;
use playback::Playback;
use stick::{Push, StickSnap};

use crate::clock::Clock;
use program::{Standpoint, Subject};

/// Angle in radians by which a push of the stick turns the clip about the viewer's head at once: less motion sickness than
/// a smooth turn.
const SNAP_TURN: f64 = 30.0 * std::f64::consts::PI / 180.0;

/// State of the hands, and the clip that they move, if there is one.
#[derive(Clone, Debug, Default)]
pub struct Interaction {
    clip: Option<Placed>,
    inputs: Inputs,
    sticks: [StickSnap; 2],
    /// Hands whose trigger was pulled away from the panel: it holds the clip until its release.
    select_holds: [bool; 2],
    grab: Grab,
    playback: Playback,
    elapsed_s: f64,
    /// Whether the viewer has moved the clip since [`Interaction::take_moved`].
    moved: bool,
}

/// A clip and its placement.
#[derive(Clone, Copy, Debug)]
struct Placed {
    subject: Subject,
    placement: Placement,
}

impl Interaction {
    /// Puts a clip at `placement`, for instance from a [`PlacementStore`], in place of the present one. Hands
    /// that hold keep holding.
    pub fn put(&mut self, subject: Subject, placement: Placement) {
        self.clip = Some(Placed { subject, placement });
    }

    /// Removes the clip. Buttons and sticks stay active.
    pub fn take_away(&mut self) {
        (self.clip, self.select_holds, self.grab) = (None, [false; 2], Grab::default());
        self.moved = false;
    }

    /// Takes in the hands of a frame of `elapsed_s` seconds. `focused` is whether the runtime gives input to
    /// this program.
    pub fn take(&mut self, hands: &Hands, focused: bool, elapsed_s: f64) {
        self.elapsed_s = if elapsed_s.is_finite() { elapsed_s.max(0.0) } else { 0.0 };
        self.inputs.update(hands, focused, self.elapsed_s);
    }

    /// The hands as of [`take`](Interaction::take).
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// Moves the clip by the hands, and appends the commands of buttons and sticks. `head` is the pose between
    /// the eyes; `on_panel` says which hands, left then right, point at the panel.
    pub fn update(
        &mut self,
        head: &Pose,
        on_panel: [bool; 2],
        clock: &Clock,
        commands: &mut Vec<Command>,
        haptics: &mut Haptics,
    ) {
        let inputs = &self.inputs;
        let pushes = Side::BOTH.map(|side| self.sticks[side as usize].update(inputs.stick(side)));
        let pushed = self.sticks[Side::Left as usize].pushed();
        self.playback.update(inputs, pushes, pushed, self.elapsed_s, clock, commands);

        let Some(Placed { placement, .. }) = &mut self.clip else { return };
        let before = *placement;
        // As the viewer turns right, the clip moves to the left.
        let angle = match pushes[Side::Right as usize] {
            Some(Push::Right) => SNAP_TURN,
            Some(Push::Left) => -SNAP_TURN,
            _ => 0.0,
        };
        if angle != 0.0 {
            *placement = placement.turned_about(head.position.as_dvec3(), angle);
            haptics.play(Side::Right, Pulse::SNAP);
        }

        let holding = Side::BOTH.map(|side| {
            let by_select = &mut self.select_holds[side as usize];
            *by_select |= inputs.pressed(side, Button::Select) && !on_panel[side as usize];
            *by_select &= inputs.is_held(side, Button::Select);
            (*by_select || inputs.is_held(side, Button::Squeeze)).then(|| inputs.grip(side)).flatten()
        });
        *placement = self.grab.update(holding, *placement, haptics);
        self.moved |= *placement != before;
    }

    /// Puts the clip, as the viewer asks for, at life size in front of a viewer with the head at `head`, at `standpoint`
    /// if there is one.
    pub fn recentre(&mut self, head: &Pose, standpoint: Option<Standpoint>) {
        if let Some(Placed { subject, placement }) = &mut self.clip {
            *placement = Placement::start_at(subject, head, standpoint, 1.0);
            self.moved = true;
        }
    }

    /// Keeps the clip in the room, or before the viewer, when the stage or the viewer's origin has changed. The head is at
    /// `head` after the change. The viewer has not moved the clip thereby.
    pub fn change_space(&mut self, change: SpaceChange, head: &Pose, standpoint: Option<Standpoint>) {
        if let Some(Placed { subject, placement }) = &mut self.clip {
            *placement = match change {
                SpaceChange::Stage { old_from_new } => placement.seen_from(&old_from_new),
                SpaceChange::Viewer => Placement::start_at(subject, head, standpoint, placement.scale()),
            };
        }
    }

    /// Placement of the clip; `None` without a clip.
    pub fn placement(&self) -> Option<&Placement> {
        self.clip.as_ref().map(|clip| &clip.placement)
    }

    /// Transform from clip to stage; `None` without a clip.
    pub fn stage_from_clip(&self) -> Option<Similarity> {
        self.clip.as_ref().map(|clip| clip.placement.stage_from_clip(&clip.subject))
    }

    /// Whether a stick scrubs: the clock must then not advance by itself.
    pub fn is_scrubbing(&self) -> bool {
        self.playback.is_scrubbing()
    }

    /// Whether the viewer has moved the clip since the last call.
    pub fn take_moved(&mut self) -> bool {
        std::mem::take(&mut self.moved)
    }

    /// Whether a hand holds the clip.
    pub fn is_holding(&self) -> bool {
        self.grab.is_holding()
    }
}

#[cfg(test)]
mod tests;
