//! The buttons, in one table that both acts and is listed on the panel, and the stick that steps and scrubs.

use super::command::Command;
use super::hands::{Button, Side};
use super::inputs::Inputs;
use super::stick::{Push, STICK_CENTRE};
use crate::clock::Clock;

/// Longest tap in seconds.
const TAP_S: f64 = 0.5;

/// Seconds after which a held button has its second effect.
const HOLD_S: f64 = 0.7;

/// Seconds after which a held button ends the program: long enough to exclude a slip.
const EXIT_S: f64 = 1.5;

/// Seconds after which a pushed stick scrubs instead of stepping.
const SCRUB_AFTER_S: f64 = 0.5;

/// Seconds in which a fully pushed stick scrubs through a clip, and the lowest such rate in seconds of the clip
/// per second.
const SCRUB_THROUGH_S: f64 = 5.0;
const SCRUB_RATE_LEAST: f64 = 1.0;

/// When a button acts.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Gesture {
    /// On the press.
    Press,
    /// On a release soon after the press.
    Tap,
    /// After this many seconds of being held.
    Hold(f64),
}

/// One line of the table.
pub struct Binding {
    /// Hands to which the line applies.
    sides: &'static [Side],
    button: Button,
    gesture: Gesture,
    command: Command,
    /// The button in the list; empty if another line covers it.
    pub label: &'static str,
    /// Effect, in words.
    pub action: &'static str,
}

const LEFT: &[Side] = &[Side::Left];
const RIGHT: &[Side] = &[Side::Right];

const fn bind(
    sides: &'static [Side],
    (button, gesture): (Button, Gesture),
    command: Command,
    label: &'static str,
    action: &'static str,
) -> Binding {
    Binding { sides, button, gesture, command, label, action }
}

/// Effects of the buttons.
pub const BUTTONS: [Binding; 9] = {
    use Button::{Menu, Primary, Secondary};
    use Gesture::{Hold, Press, Tap};
    [
        bind(RIGHT, (Primary, Press), Command::TogglePlaying, "A", "Play or pause"),
        bind(RIGHT, (Secondary, Tap), Command::TogglePanel, "B or menu", "This panel"),
        bind(RIGHT, (Secondary, Hold(EXIT_S)), Command::Exit, "Hold B or menu", "Exit"),
        bind(LEFT, (Primary, Tap), Command::NextClip, "X", "Next clip"),
        bind(LEFT, (Primary, Hold(HOLD_S)), Command::ToggleStatistics, "Hold X", "Statistics"),
        bind(LEFT, (Secondary, Tap), Command::Recentre, "Y", "Recentre"),
        bind(LEFT, (Secondary, Hold(HOLD_S)), Command::ToggleLoop, "Hold Y", "Loop on or off"),
        bind(&Side::BOTH, (Menu, Tap), Command::TogglePanel, "", ""),
        bind(&Side::BOTH, (Menu, Hold(EXIT_S)), Command::Exit, "", ""),
    ]
};

/// Effects of sticks and held hands, for the list.
pub const GESTURES: [(&str, &str); 7] = [
    ("Trigger", "Press on the panel"),
    ("Grip, trigger elsewhere", "Carry the clip"),
    ("Both grips", "Move, turn, scale"),
    ("Left stick across", "Step, held: scrub"),
    ("Left stick up, down", "Faster, slower"),
    ("Right stick across", "Turn"),
    ("Right stick up, down", "Quality"),
];

/// The stick that steps and scrubs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Playback {
    /// Seconds for which the left stick has been pushed sideways.
    pushed_s: f64,
}

impl Playback {
    /// Appends the commands of buttons and sticks in a frame of `elapsed_s` seconds. `pushes` begin in this
    /// frame, left then right; `pushed` is the push under way on the left.
    pub(super) fn update(
        &mut self,
        inputs: &Inputs,
        pushes: [Option<Push>; 2],
        pushed: Option<Push>,
        elapsed_s: f64,
        clock: &Clock,
        commands: &mut Vec<Command>,
    ) {
        for binding in &BUTTONS {
            let acts = |&side: &Side| match binding.gesture {
                Gesture::Press => inputs.pressed(side, binding.button),
                Gesture::Tap => inputs.tapped(side, binding.button, TAP_S),
                Gesture::Hold(after_s) => inputs.held_for(side, binding.button, after_s),
            };
            if binding.sides.iter().any(acts) {
                commands.push(binding.command);
            }
        }
        let [left, right] = pushes;
        commands.extend(left.map(|push| match push {
            Push::Left => Command::StepBack,
            Push::Right => Command::StepForward,
            Push::Up => Command::Faster,
            Push::Down => Command::Slower,
        }));
        match right {
            Some(Push::Up) => commands.push(Command::Better),
            Some(Push::Down) => commands.push(Command::Coarser),
            Some(Push::Left | Push::Right) | None => {}
        }
        if matches!(pushed, Some(Push::Left | Push::Right)) {
            self.pushed_s += elapsed_s;
        } else {
            self.pushed_s = 0.0;
        }
        if self.is_scrubbing() {
            // From 0 at the edge of the rest zone to 1 at the rim.
            let x = f64::from(inputs.stick(Side::Left).x);
            let centre = f64::from(STICK_CENTRE);
            let part = ((x.abs() - centre) / (1.0 - centre)).max(0.0).copysign(x);
            let rate = (clock.duration_s() / SCRUB_THROUGH_S).max(SCRUB_RATE_LEAST);
            commands.push(Command::Seek(clock.position_s() + part * rate * elapsed_s));
        }
    }

    /// Whether the stick scrubs.
    pub(super) fn is_scrubbing(&self) -> bool {
        self.pushed_s >= SCRUB_AFTER_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_gesture_means_two_things() {
        for (i, a) in BUTTONS.iter().enumerate() {
            for b in &BUTTONS[..i] {
                let together = a.button == b.button && a.sides.iter().any(|side| b.sides.contains(side));
                let apart = match (a.gesture, b.gesture) {
                    (Gesture::Tap, Gesture::Hold(after_s)) | (Gesture::Hold(after_s), Gesture::Tap) => {
                        after_s > TAP_S
                    }
                    _ => false,
                };
                assert!(!together || apart, "{:?} and {:?}", a.command, b.command);
            }
        }
    }
}
