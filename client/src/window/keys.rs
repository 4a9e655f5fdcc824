//! The keys: one table for commands and for the list of keys, and the keys held to fly.

use egui::{Event, InputState, Key};

use super::camera::Fly;

/// A command of a key or a button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Command {
    TogglePlaying,
    StepBack,
    StepForward,
    GoToStart,
    Slower,
    Faster,
    NormalSpeed,
    ToggleReverse,
    ToggleLoop,
    ToggleMuted,
    /// The viewpoint of this index.
    GoToViewpoint(usize),
    Recentre,
    /// Another axis of the clip points up.
    TurnUp,
    Screenshot,
    OpenFile,
    PreviousClip,
    NextClip,
    /// What the window shows becomes the poster of the clip.
    SetPoster,
    ToggleKeys,
    ToggleStatistics,
    ToggleInterface,
    ToggleFullScreen,
    Dismiss,
}

/// A line of the table.
pub(crate) struct Binding {
    keys: &'static [Key],
    command: Command,
    /// Whether a held key repeats the command.
    repeats: bool,
    /// Name of the keys in the list.
    pub(crate) label: &'static str,
    /// Name of the command in the list.
    pub(crate) action: &'static str,
}

const fn once(keys: &'static [Key], command: Command, label: &'static str, action: &'static str) -> Binding {
    Binding { keys, command, repeats: false, label, action }
}

const fn repeating(
    keys: &'static [Key],
    command: Command,
    label: &'static str,
    action: &'static str,
) -> Binding {
    Binding { keys, command, repeats: true, label, action }
}

/// Keys that control the player.
pub(crate) const PLAYING: [Binding; 10] = [
    once(&[Key::Space], Command::TogglePlaying, "Space", "Play or pause"),
    repeating(&[Key::ArrowLeft, Key::Comma], Command::StepBack, "Left or ,", "One frame back"),
    repeating(&[Key::ArrowRight, Key::Period], Command::StepForward, "Right or .", "One frame on"),
    once(&[Key::Home], Command::GoToStart, "Home", "Start of the clip"),
    repeating(&[Key::Minus, Key::ArrowDown], Command::Slower, "Down or -", "Slower"),
    repeating(&[Key::Plus, Key::Equals, Key::ArrowUp], Command::Faster, "Up or +", "Faster"),
    once(&[Key::Backspace], Command::NormalSpeed, "Backspace", "Normal speed"),
    once(&[Key::B], Command::ToggleReverse, "B", "Play backwards or forward"),
    once(&[Key::L], Command::ToggleLoop, "L", "Loop on or off"),
    once(&[Key::M], Command::ToggleMuted, "M", "Sound on or off"),
];

/// Keys that control the window.
pub(crate) const WINDOW: [Binding; 11] = [
    once(&[Key::O], Command::OpenFile, "O", "Open a file"),
    once(&[Key::PageUp], Command::PreviousClip, "Page Up", "Previous clip"),
    once(&[Key::PageDown], Command::NextClip, "Page Down", "Next clip"),
    once(&[Key::R], Command::Recentre, "R", "Back to the viewpoint"),
    once(&[Key::T], Command::TurnUp, "T", "Turn another axis up"),
    once(&[Key::P], Command::Screenshot, "P", "Save a picture"),
    once(&[Key::I], Command::ToggleStatistics, "I", "Statistics"),
    once(&[Key::U], Command::ToggleInterface, "U", "Hide or show the controls"),
    once(&[Key::H, Key::F1], Command::ToggleKeys, "H", "This list"),
    once(&[Key::F, Key::F11], Command::ToggleFullScreen, "F or F11", "Full screen on or off"),
    once(&[Key::Escape], Command::Dismiss, "Esc", "Close a list or message, leave full screen"),
];

/// The list of mouse and flying controls.
pub(crate) const CAMERA: [(&str, &str); 9] = [
    ("Left drag", "Orbit"),
    ("Right drag, Shift + drag", "Pan"),
    ("Wheel", "Zoom"),
    ("W A S D", "Fly"),
    ("Q E", "Fly down, up"),
    ("Shift", "Fly faster"),
    ("Left drag in flight, Ctrl + drag", "Look around"),
    ("1 ... 9", "Viewpoints"),
    ("Double click", "Full screen on or off"),
];

/// The keys of the first viewpoints.
const VIEWPOINTS: [Key; 9] =
    [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];

/// Keys that operate a control with the keyboard focus, which gets them alone.
const CONTROL_KEYS: [Key; 6] =
    [Key::Space, Key::Enter, Key::ArrowLeft, Key::ArrowRight, Key::ArrowUp, Key::ArrowDown];

/// Commands of the keys pressed since the last frame. `control_has_focus` is whether a control has the keyboard focus.
pub(crate) fn commands(input: &InputState, control_has_focus: bool) -> Vec<Command> {
    let is_free = |event: &&Event| match event {
        Event::Key { key, .. } => !control_has_focus || !CONTROL_KEYS.contains(key),
        _ => true,
    };
    input.events.iter().filter(is_free).filter_map(command).collect()
}

fn command(event: &Event) -> Option<Command> {
    let &Event::Key { key, physical_key, pressed: true, repeat, modifiers } = event else {
        return None;
    };
    // Combinations belong to the desktop. A flying key, identified by its position, has no other command.
    if modifiers.ctrl || modifiers.alt || modifiers.command || is_fly_key(physical_key.unwrap_or(key)) {
        return None;
    }
    // Digits by position: some layouts type them only with Shift.
    let digit = |key: Key| VIEWPOINTS.iter().position(|&digit| digit == key);
    if let Some(number) = digit(key).or_else(|| physical_key.and_then(digit)) {
        return (!repeat).then_some(Command::GoToViewpoint(number));
    }
    let binding = PLAYING.iter().chain(&WINDOW).find(|binding| binding.keys.contains(&key))?;
    (!repeat || binding.repeats).then_some(binding.command)
}

/// Flying keys by position: left, right, back, forward, down, up.
const FLY_KEYS: [Key; 6] = [Key::A, Key::D, Key::S, Key::W, Key::Q, Key::E];

fn is_fly_key(key: Key) -> bool {
    FLY_KEYS.contains(&key)
}

/// The flying keys held down.
#[derive(Debug, Default)]
pub(crate) struct FlyKeys {
    held: [bool; FLY_KEYS.len()],
    fast: bool,
}

impl FlyKeys {
    /// Updates from the keys pressed and released since the last frame.
    pub(crate) fn update(&mut self, input: &InputState) {
        for event in &input.events {
            match *event {
                Event::Key { key, physical_key, pressed, modifiers, .. } => {
                    let key = physical_key.unwrap_or(key);
                    if let Some(index) = FLY_KEYS.iter().position(|&fly| fly == key) {
                        self.held[index] = pressed && !modifiers.ctrl && !modifiers.alt && !modifiers.command;
                    }
                }
                // Another window receives the releases of these keys.
                Event::WindowFocused(false) => self.held = Default::default(),
                _ => {}
            }
        }
        self.fast = input.modifiers.shift;
    }

    /// Releases all keys.
    pub(crate) fn release(&mut self) {
        self.held = Default::default();
    }

    /// The direction of flight.
    pub(crate) fn fly(&self) -> Fly {
        let axis = |negative: usize| f64::from(self.held[negative + 1]) - f64::from(self.held[negative]);
        Fly { right: axis(0), forward: axis(2), up: axis(4), fast: self.fast }
    }
}

#[cfg(test)]
mod tests {
    use egui::Modifiers;

    use super::*;

    fn press(key: Key) -> Event {
        Event::Key { key, physical_key: Some(key), pressed: true, repeat: false, modifiers: Modifiers::NONE }
    }

    fn input(events: Vec<Event>) -> InputState {
        let mut input = InputState::default();
        input.events = events;
        input
    }

    #[test]
    fn no_key_is_bound_twice() {
        let mut keys: Vec<Key> =
            PLAYING.iter().chain(&WINDOW).flat_map(|binding| binding.keys).copied().collect();
        keys.extend(VIEWPOINTS);
        keys.extend(FLY_KEYS);
        for (i, key) in keys.iter().enumerate() {
            assert!(!keys[..i].contains(key), "{key:?} is bound twice");
        }
    }

    #[test]
    fn keys_give_their_commands_in_order() {
        let events = vec![press(Key::Space), press(Key::Z), press(Key::Num3), press(Key::ArrowLeft)];
        let expected = [Command::TogglePlaying, Command::GoToViewpoint(2), Command::StepBack];
        assert_eq!(commands(&input(events), false), expected);
    }

    #[test]
    fn only_some_keys_repeat() {
        let held = |key| {
            let Event::Key { key, physical_key, pressed, modifiers, .. } = press(key) else { unreachable!() };
            Event::Key { key, physical_key, pressed, repeat: true, modifiers }
        };
        assert_eq!(
            commands(&input(vec![held(Key::Space), held(Key::Num1), held(Key::Period)]), false),
            [Command::StepForward]
        );
    }

    #[test]
    fn a_control_with_the_focus_takes_the_keys_that_operate_it() {
        let events = vec![press(Key::Space), press(Key::ArrowLeft), press(Key::Comma), press(Key::H)];
        assert_eq!(commands(&input(events), true), [Command::StepBack, Command::ToggleKeys]);
    }

    #[test]
    fn combinations_give_no_command() {
        let event = Event::Key {
            key: Key::P,
            physical_key: Some(Key::P),
            pressed: true,
            repeat: false,
            modifiers: Modifiers::CTRL,
        };
        assert_eq!(commands(&input(vec![event]), false), []);
    }

    #[test]
    fn flying_keys_go_by_position_until_release_or_loss_of_focus() {
        let key = |physical_key, pressed| Event::Key {
            // An AZERTY keyboard types other letters there.
            key: if physical_key == Key::W { Key::Z } else { Key::Q },
            physical_key: Some(physical_key),
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        let mut keys = FlyKeys::default();
        keys.update(&input(vec![key(Key::W, true), key(Key::A, true)]));
        assert_eq!(keys.fly(), Fly { right: -1.0, up: 0.0, forward: 1.0, fast: false });
        keys.update(&input(vec![key(Key::A, false)]));
        assert_eq!(keys.fly(), Fly { right: 0.0, up: 0.0, forward: 1.0, fast: false });
        keys.update(&input(vec![Event::WindowFocused(false)]));
        assert!(!keys.fly().is_flying());
    }

    #[test]
    fn a_flying_key_gives_no_command() {
        let event = Event::Key {
            key: Key::Period,
            physical_key: Some(Key::E),
            pressed: true,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        assert_eq!(commands(&input(vec![event]), false), []);
    }
}
