//! [`Life`]: the states of a session, as a function from the runtime's events to what to do.

/// What a runtime says a session is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum State {
    /// Nothing is shown; the headset may be off.
    #[default]
    Idle,
    /// It waits to be begun.
    Ready,
    /// Frames are timed, and not seen.
    Synchronized,
    /// Frames are seen; hands are for someone else, as while the system's menu is open.
    Visible,
    /// Frames are seen and hands are ours.
    Focused,
    /// It waits to be ended.
    Stopping,
    /// It will be lost.
    LossPending,
    /// The viewer wants to leave.
    Exiting,
}

/// What a runtime tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// The session is now in this state.
    State(State),
    /// At this display time, in nanoseconds, the origin of the stage moves: the viewer asked to be
    /// in the middle, or put up another guard.
    SpaceChanges { at_ns: i64 },
    /// The runtime itself goes away.
    InstanceLossPending,
}

/// What to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// Begin the session: frames run from now on.
    Begin,
    /// End it: no frames until it begins again.
    End,
    /// Destroy it and leave the program.
    Leave,
    /// Destroy it and open another.
    Renew,
    /// Put the clip before the viewer anew, from this display time on.
    Replace { at_ns: i64 },
    /// Leave the program with an error.
    Fail,
}

/// Where a session is between opening and leaving.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Life {
    state: State,
    /// Begun and not ended.
    running: bool,
    /// The program asked the runtime to let it leave.
    exit_asked: bool,
}

impl Life {
    /// The life after `event`, and what to do now.
    pub(super) fn on(self, event: Event) -> (Life, Option<Action>) {
        let state = match event {
            Event::State(state) => state,
            Event::SpaceChanges { at_ns } => return (self, Some(Action::Replace { at_ns })),
            Event::InstanceLossPending => return (self, Some(Action::Fail)),
        };
        let mut next = Life { state, ..self };
        let action = match state {
            State::Ready if !self.running => Some(Action::Begin),
            State::Stopping if self.running => Some(Action::End),
            State::Exiting => Some(Action::Leave),
            State::LossPending if self.exit_asked => Some(Action::Leave),
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

    /// Whether the runtime wants frames: also unseen ones, or it would never show any.
    pub(super) fn wants_frames(&self) -> bool {
        self.running
    }

    /// Whether the viewer is with this program. Otherwise hands are not for it and the clip waits:
    /// nobody misses what happens behind the system's menu, or with the headset off.
    pub(super) fn has_focus(&self) -> bool {
        self.running && self.state == State::Focused
    }

    /// Whether to ask the runtime for leave: once, and only of a session that runs.
    pub(super) fn ask_exit(&mut self) -> bool {
        !std::mem::replace(&mut self.exit_asked, true) && self.running
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lets a session go through `states` and returns it with what was to be done.
    fn live(states: &[State]) -> (Life, Vec<Action>) {
        let mut actions = Vec::new();
        let life = states.iter().fold(Life::default(), |life, &state| {
            let (life, action) = life.on(Event::State(state));
            actions.extend(action);
            life
        });
        (life, actions)
    }

    #[test]
    fn a_session_begins_plays_and_leaves() {
        use State::*;
        let (life, actions) = live(&[Idle, Ready, Synchronized, Visible, Focused]);
        assert!(life.wants_frames() && life.has_focus());
        assert_eq!(actions, [Action::Begin]);
        let (life, actions) = live(&[
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
        assert!(!life.wants_frames() && !life.has_focus());
        assert_eq!(actions, [Action::Begin, Action::End, Action::Leave]);
    }

    #[test]
    fn the_clip_waits_whenever_the_viewer_is_away() {
        use State::*;
        for away in [Ready, Synchronized, Visible] {
            let (life, _) = live(&[Idle, Ready, Synchronized, Visible, Focused, away]);
            assert!(life.wants_frames() && !life.has_focus(), "{away:?}");
        }
        let (life, _) = live(&[Idle, Ready, Synchronized, Visible, Focused, Visible, Focused]);
        assert!(life.has_focus(), "back from the system's menu");
    }

    #[test]
    fn a_headset_taken_off_and_on_again_starts_over() {
        use State::*;
        let (life, actions) = live(&[
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
        assert!(life.wants_frames() && life.has_focus());
        assert_eq!(actions, [Action::Begin, Action::End, Action::Begin]);
    }

    #[test]
    fn a_lost_session_is_renewed_unless_it_was_leaving() {
        use State::*;
        let (mut life, actions) = live(&[Idle, Ready, Focused]);
        assert_eq!(actions, [Action::Begin]);
        let (lost, action) = life.on(Event::State(LossPending));
        assert_eq!((lost.wants_frames(), action), (false, Some(Action::Renew)));
        assert!(life.ask_exit() && !life.ask_exit(), "asked once");
        assert_eq!(life.on(Event::State(LossPending)).1, Some(Action::Leave));
        assert!(!Life::default().ask_exit(), "a session that does not run has no leave to ask for");
    }

    #[test]
    fn the_runtime_going_away_is_an_error_in_every_state() {
        for states in [&[][..], &[State::Ready], &[State::Ready, State::Stopping]] {
            let (life, _) = live(states);
            assert_eq!(life.on(Event::InstanceLossPending), (life, Some(Action::Fail)));
            let moved = Event::SpaceChanges { at_ns: 5 };
            assert_eq!(life.on(moved), (life, Some(Action::Replace { at_ns: 5 })));
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
