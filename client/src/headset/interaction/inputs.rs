//! [`Inputs`]: buttons and sticks over time: presses, taps and holds.
//!
//! An untracked hand, or a program without the focus, holds nothing. A button that is down when hand or focus
//! comes back counts only after its release: the press was meant for another program.

use glam::Vec2;

use super::hands::{Button, Hands, Pose, Side};
use super::stick::STICK_CENTRE;

const BUTTONS: usize = Button::ALL.len();

/// Seconds for which a button has been held; `None` for a released one.
type Held = Option<f64>;

/// Both hands, with their recent past.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    sides: [SideInputs; 2],
}

#[derive(Clone, Copy, Debug, Default)]
struct SideInputs {
    /// `None` while the hand is not tracked.
    poses: Option<Poses>,
    held: [Held; BUTTONS],
    /// In the previous frame.
    held_before: [Held; BUTTONS],
    stick: Vec2,
    /// Buttons, and the stick, that were at rest since the hand came back.
    button_ready: [bool; BUTTONS],
    stick_ready: bool,
}

#[derive(Clone, Copy, Debug)]
struct Poses {
    aim: Pose,
    grip: Pose,
}

impl Inputs {
    /// Takes in the hands of a frame of `elapsed_s` seconds. `focused` is whether input is for this program.
    pub fn update(&mut self, hands: &Hands, focused: bool, elapsed_s: f64) {
        let elapsed_s = if elapsed_s.is_finite() { elapsed_s.max(0.0) } else { 0.0 };
        for side in Side::BOTH {
            let (hand, inputs) = (hands.on(side), &mut self.sides[side as usize]);
            let is_present = focused && hand.tracked && hand.aim.is_valid() && hand.grip.is_valid();
            inputs.held_before = inputs.held;
            if !is_present {
                *inputs = SideInputs::default();
                continue;
            }
            inputs.poses = Some(Poses { aim: hand.aim, grip: hand.grip });
            for (index, button) in Button::ALL.into_iter().enumerate() {
                let down = hand.is_down(button);
                inputs.button_ready[index] |= !down;
                inputs.held[index] = (down && inputs.button_ready[index])
                    .then(|| inputs.held[index].map_or(0.0, |held_s| held_s + elapsed_s));
            }
            let stick = if hand.stick.is_finite() { hand.stick.clamp_length_max(1.0) } else { Vec2::ZERO };
            inputs.stick_ready |= stick.abs().max_element() < STICK_CENTRE;
            inputs.stick = if inputs.stick_ready { stick } else { Vec2::ZERO };
        }
    }

    /// Aim pose of a hand, if it is tracked.
    pub fn aim(&self, side: Side) -> Option<Pose> {
        self.sides[side as usize].poses.map(|poses| poses.aim)
    }

    /// Grip pose of a hand, if it is tracked.
    pub fn grip(&self, side: Side) -> Option<Pose> {
        self.sides[side as usize].poses.map(|poses| poses.grip)
    }

    /// Deflection to the right and up, of length 1 at most.
    pub fn stick(&self, side: Side) -> Vec2 {
        self.sides[side as usize].stick
    }

    /// Whether a button is held.
    pub fn is_held(&self, side: Side, button: Button) -> bool {
        self.held(side, button).is_some()
    }

    /// Whether a button went down in this frame.
    pub fn pressed(&self, side: Side, button: Button) -> bool {
        self.held(side, button).is_some() && self.held_before(side, button).is_none()
    }

    /// Whether a button was released in this frame after less than `within_s` seconds. Losing a hand releases
    /// nothing.
    pub fn tapped(&self, side: Side, button: Button, within_s: f64) -> bool {
        self.held(side, button).is_none()
            && self.held_before(side, button).is_some_and(|held_s| held_s < within_s)
    }

    /// Whether a button has reached `after_s` seconds of being held in this frame.
    pub fn held_for(&self, side: Side, button: Button, after_s: f64) -> bool {
        let passed = |held: Held| held.is_some_and(|held_s| held_s >= after_s);
        passed(self.held(side, button)) && !passed(self.held_before(side, button))
    }

    fn held(&self, side: Side, button: Button) -> Held {
        self.sides[side as usize].held[button as usize]
    }

    fn held_before(&self, side: Side, button: Button) -> Held {
        self.sides[side as usize].held_before[button as usize]
    }
}

#[cfg(test)]
mod tests {
    use glam::vec2;

    use super::super::hands::Hand;
    use super::*;

    const A: (Side, Button) = (Side::Right, Button::Primary);

    fn hands(primary: bool) -> Hands {
        let right = Hand { tracked: true, primary, ..Hand::default() };
        Hands { right, ..Hands::default() }
    }

    fn inputs(history: &[(bool, bool)]) -> Inputs {
        let mut inputs = Inputs::default();
        for &(down, focused) in history {
            inputs.update(&hands(down), focused, 0.1);
        }
        inputs
    }

    #[test]
    fn a_press_and_a_tap_are_reported_once() {
        let up = (false, true);
        let down = (true, true);
        assert!(inputs(&[up, down]).pressed(A.0, A.1));
        let held = inputs(&[up, down, down]);
        assert!(!held.pressed(A.0, A.1) && held.is_held(A.0, A.1));
        assert!(inputs(&[up, down, down, up]).tapped(A.0, A.1, 0.5));
        assert!(!inputs(&[up, down, down, up, up]).tapped(A.0, A.1, 0.5));
        assert!(!inputs(&[up, down, down, up]).tapped(A.0, A.1, 0.05), "too long for a tap");
    }

    #[test]
    fn a_hold_is_reported_once() {
        let mut inputs = inputs(&[(false, true), (true, true)]);
        let found: Vec<usize> = (1..20)
            .filter(|_| {
                inputs.update(&hands(true), true, 0.1);
                inputs.held_for(A.0, A.1, 0.55)
            })
            .collect();
        assert_eq!(found, [6]);
    }

    #[test]
    fn a_button_held_since_before_the_focus_counts_only_after_its_release() {
        assert!(!inputs(&[(true, true)]).is_held(A.0, A.1), "held since before the program began");
        let back = inputs(&[(false, true), (true, true), (true, false), (true, true)]);
        assert!(!back.is_held(A.0, A.1) && !back.pressed(A.0, A.1));
        let again = inputs(&[(true, false), (true, true), (false, true), (true, true)]);
        assert!(again.pressed(A.0, A.1));
    }

    #[test]
    fn losing_the_focus_or_the_hand_is_no_tap() {
        assert!(!inputs(&[(false, true), (true, true), (false, false)]).tapped(A.0, A.1, 0.5));
        let mut inputs = inputs(&[(false, true), (true, true)]);
        inputs.update(&Hands::default(), true, 0.1);
        assert!(!inputs.tapped(A.0, A.1, 0.5) && inputs.aim(A.0).is_none());
    }

    #[test]
    fn a_stick_counts_once_it_was_at_rest() {
        let hands =
            |stick| Hands { left: Hand { tracked: true, stick, ..Hand::default() }, ..Hands::default() };
        let mut inputs = Inputs::default();
        inputs.update(&hands(Vec2::X), true, 0.1);
        assert_eq!(inputs.stick(Side::Left), Vec2::ZERO);
        inputs.update(&hands(Vec2::ZERO), true, 0.1);
        inputs.update(&hands(vec2(2.0, 0.0)), true, 0.1);
        assert_eq!(inputs.stick(Side::Left), Vec2::X);
        inputs.update(&hands(Vec2::NAN), true, 0.1);
        assert_eq!(inputs.stick(Side::Left), Vec2::ZERO);
    }

    #[test]
    fn implausible_poses_count_as_lost() {
        let mut inputs = Inputs::default();
        let mut hands = hands(false);
        inputs.update(&hands, true, 0.1);
        assert!(inputs.grip(Side::Right).is_some() && inputs.grip(Side::Left).is_none());
        hands.right.grip.position.y = f32::NAN;
        inputs.update(&hands, true, 0.1);
        assert!(inputs.grip(Side::Right).is_none());
    }
}
