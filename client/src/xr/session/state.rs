//! [`SessionLifecycle`]: the states of a session, as a function from the runtime's events to actions.

use crate::headset::interaction::SpaceChange;
use crate::headset::show::quality::Heat;

/// The state of a session, as the runtime reports it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::xr) enum State {
    /// The runtime shows nothing; the headset may be off.
    #[default]
    Idle,
    /// The program may begin the session.
    Ready,
    /// Frames are timed and not shown.
    Synchronized,
    /// Frames are shown; input goes elsewhere, as while the system's menu is open.
    Visible,
    /// Frames are shown and input comes to this program.
    Focused,
    /// The program must end the session.
    Stopping,
    /// The runtime is about to drop the session.
    LossPending,
    /// The viewer wants to leave.
    Exiting,
}

/// An event of the runtime.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::xr) enum Event {
    /// The session is now in this state.
    State(State),
    /// At this display time, in nanoseconds, the spaces change: the viewer recentred the view or drew another boundary.
    SpaceChanges { at_ns: i64, change: SpaceChange },
    /// The headset is so hot.
    Heat(Heat),
    /// The runtime is about to end.
    InstanceLossPending,
}

/// What an event asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::xr) enum Action {
    /// Begin the session: frames run from now on.
    Begin,
    /// End it: no frames until it begins again.
    End,
    /// Destroy it and leave the program.
    Leave,
    /// Destroy it and open another.
    Renew,
    /// Keep the clip where it is, or in front of the viewer, in the spaces of this display time.
    ChangeSpace { at_ns: i64, change: SpaceChange },
    /// Draw with a quality for a headset that is so hot.
    ChangeHeat(Heat),
    /// Leave the program with an error.
    Fail,
}

/// The state of a session between opening and leaving.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::xr) struct SessionLifecycle {
    state: State,
    /// Begun and not ended.
    running: bool,
    /// The program has requested the exit.
    exit_requested: bool,
}

impl SessionLifecycle {
    /// The lifecycle after `event`, and the action it asks for.
    pub(in crate::xr) fn on(self, event: Event) -> (SessionLifecycle, Option<Action>) {
        let state = match event {
            Event::State(state) => state,
            Event::SpaceChanges { at_ns, change } => {
                return (self, Some(Action::ChangeSpace { at_ns, change }));
            }
            Event::Heat(heat) => return (self, Some(Action::ChangeHeat(heat))),
            Event::InstanceLossPending => return (self, Some(Action::Fail)),
        };
        let mut next = SessionLifecycle { state, ..self };
        let action = match state {
            State::Ready if !self.running => Some(Action::Begin),
            State::Stopping if self.running => Some(Action::End),
            State::Exiting => Some(Action::Leave),
            State::LossPending if self.exit_requested => Some(Action::Leave),
            State::LossPending => Some(Action::Renew),
            _ => None,
        };
        match action {
            Some(Action::Begin) => next.running = true,
            Some(Action::End | Action::Leave | Action::Renew) => next.running = false,
            _ => {}
        }
        (next, action)
    }

    /// Whether the runtime wants frames; it wants some before it shows any.
    pub(in crate::xr) fn wants_frames(&self) -> bool {
        self.running
    }

    /// Whether the viewer is with this program. Otherwise input goes elsewhere and the clip waits: the
    /// viewer would miss what plays behind the system's menu, or with the headset off.
    pub(in crate::xr) fn has_focus(&self) -> bool {
        self.running && self.state == State::Focused
    }

    /// Whether to request the exit from the runtime: once, and only of a running session.
    pub(in crate::xr) fn ask_exit(&mut self) -> bool {
        !std::mem::replace(&mut self.exit_requested, true) && self.running
    }
}

/// Frames that a session must have run before its loss not to count as dropped at once, and the most sessions
/// in a row that may be: a runtime that drops every session would be asked for another one for ever.
const LASTING_FRAMES: u64 = 50;
const DROPPED_MAX: u32 = 3;

/// Decides whether another session follows a lost one.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::xr) struct Renewals {
    /// Number of sessions in a row that were dropped at once.
    dropped: u32,
}

impl Renewals {
    /// Takes in the loss of a session that ran `frames` frames; returns whether to open another one.
    pub(in crate::xr) fn follows(&mut self, frames: u64) -> bool {
        self.dropped = if frames < LASTING_FRAMES { self.dropped + 1 } else { 0 };
        self.dropped <= DROPPED_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lifecycle after `states`, and the actions on the way.
    fn live(states: &[State]) -> (SessionLifecycle, Vec<Action>) {
        let mut actions = Vec::new();
        let lifecycle = states.iter().fold(SessionLifecycle::default(), |lifecycle, &state| {
            let (lifecycle, action) = lifecycle.on(Event::State(state));
            actions.extend(action);
            lifecycle
        });
        (lifecycle, actions)
    }

    #[test]
    fn a_session_begins_plays_and_leaves() {
        use State::*;
        let (lifecycle, actions) = live(&[Idle, Ready, Synchronized, Visible, Focused]);
        assert!(lifecycle.wants_frames() && lifecycle.has_focus());
        assert_eq!(actions, [Action::Begin]);
        let (lifecycle, actions) = live(&[
            Idle,
            Ready,
            Synchronized,
            Visible,
            Focused,
            Visible,
            Synchronized,
            Stopping,
            Idle,
            Exiting,
        ]);
        assert!(!lifecycle.wants_frames() && !lifecycle.has_focus());
        assert_eq!(actions, [Action::Begin, Action::End, Action::Leave]);
    }

    #[test]
    fn the_clip_waits_whenever_the_viewer_is_away() {
        use State::*;
        for away in [Ready, Synchronized, Visible] {
            let (lifecycle, _) = live(&[Idle, Ready, Synchronized, Visible, Focused, away]);
            assert!(lifecycle.wants_frames() && !lifecycle.has_focus(), "{away:?}");
        }
        let (lifecycle, _) = live(&[Idle, Ready, Synchronized, Visible, Focused, Visible, Focused]);
        assert!(lifecycle.has_focus(), "back from the system's menu");
    }

    #[test]
    fn a_headset_taken_off_and_on_again_starts_over() {
        use State::*;
        let (lifecycle, actions) = live(&[
            Idle,
            Ready,
            Focused,
            Visible,
            Synchronized,
            Stopping,
            Idle,
            Ready,
            Synchronized,
            Focused,
        ]);
        assert!(lifecycle.wants_frames() && lifecycle.has_focus());
        assert_eq!(actions, [Action::Begin, Action::End, Action::Begin]);
    }

    #[test]
    fn a_lost_session_is_renewed_unless_it_was_leaving() {
        use State::*;
        let (mut lifecycle, actions) = live(&[Idle, Ready, Focused]);
        assert_eq!(actions, [Action::Begin]);
        let (lost, action) = lifecycle.on(Event::State(LossPending));
        assert_eq!((lost.wants_frames(), action), (false, Some(Action::Renew)));
        assert!(lifecycle.ask_exit() && !lifecycle.ask_exit(), "requested once");
        assert_eq!(lifecycle.on(Event::State(LossPending)).1, Some(Action::Leave));
        assert!(!SessionLifecycle::default().ask_exit(), "a session that does not run cannot exit");
    }

    #[test]
    fn a_runtime_that_drops_every_session_is_not_asked_for_ever() {
        let mut renewals = Renewals::default();
        for frames in [1000, 0, 0, LASTING_FRAMES - 1, LASTING_FRAMES, 0, 0, 0] {
            assert!(renewals.follows(frames), "{frames}");
        }
        assert!(!renewals.follows(0), "four in a row");
    }

    #[test]
    fn the_runtime_going_away_is_an_error_in_every_state() {
        for states in [&[][..], &[State::Ready], &[State::Ready, State::Stopping]] {
            let (lifecycle, _) = live(states);
            assert_eq!(lifecycle.on(Event::InstanceLossPending), (lifecycle, Some(Action::Fail)));
            let (at_ns, change) = (5, SpaceChange::Viewer);
            assert_eq!(
                lifecycle.on(Event::SpaceChanges { at_ns, change }),
                (lifecycle, Some(Action::ChangeSpace { at_ns, change }))
            );
        }
    }

    #[test]
    fn no_order_of_states_begins_or_ends_twice() {
        use State::*;
        let all = [Idle, Ready, Synchronized, Visible, Focused, Stopping, LossPending, Exiting];
        // Every sequence of four, whether a runtime would send it or not.
        for code in 0..8usize.pow(4) {
            let states = [0, 1, 2, 3].map(|digit| all[code / 8usize.pow(digit) % 8]);
            let mut running = false;
            for action in live(&states).1 {
                match action {
                    Action::Begin => assert!(!std::mem::replace(&mut running, true), "{states:?}"),
                    Action::End => assert!(std::mem::replace(&mut running, false), "{states:?}"),
                    _ => running = false,
                }
            }
        }
    }
}
