//! [`StickSnap`]: single steps from the pushes of a stick.

use glam::Vec2;

/// Deflection below which a stick is at rest.
pub(super) const STICK_CENTRE: f32 = 0.4;

/// Deflection from which it is pushed.
const STICK_PUSHED: f32 = 0.7;

/// Direction of a push.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Push {
    /// To the left.
    Left,
    /// To the right.
    Right,
    /// Forward.
    Up,
    /// Backward.
    Down,
}

/// A stick that steps once for each push: it has to be at rest in between.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StickSnap {
    pushed: Option<Push>,
}

impl StickSnap {
    /// Takes in the deflection; returns the push that begins in this frame.
    pub(super) fn update(&mut self, stick: Vec2) -> Option<Push> {
        let deflection = stick.abs().max_element();
        if deflection < STICK_CENTRE {
            self.pushed = None;
        } else if self.pushed.is_none() && deflection >= STICK_PUSHED {
            self.pushed = Some(match stick {
                Vec2 { x, y } if x.abs() >= y.abs() => [Push::Left, Push::Right][usize::from(x > 0.0)],
                Vec2 { y, .. } => [Push::Down, Push::Up][usize::from(y > 0.0)],
            });
            return self.pushed;
        }
        None
    }

    /// The push under way.
    pub(super) fn pushed(&self) -> Option<Push> {
        self.pushed
    }
}

#[cfg(test)]
mod tests {
    use glam::vec2;

    use super::*;

    #[test]
    fn a_push_steps_once_until_the_stick_comes_back() {
        let mut stick = StickSnap::default();
        let steps: Vec<Option<Push>> = [0.0, 0.6, 0.75, 0.65, 0.75, 1.0, 0.5, 0.9, 0.3, 0.6, 0.8]
            .map(|x| stick.update(vec2(x, 0.1)))
            .into();
        let at: Vec<usize> = (0..steps.len()).filter(|&i| steps[i] == Some(Push::Right)).collect();
        assert_eq!(at, [2, 10], "{steps:?}");
    }

    #[test]
    fn the_stronger_axis_wins_until_the_stick_rests() {
        for (stick, push) in [
            (vec2(-0.9, 0.5), Push::Left),
            (vec2(0.8, -0.79), Push::Right),
            (vec2(0.3, 0.9), Push::Up),
            (vec2(0.7, -0.71), Push::Down),
        ] {
            let mut snap = StickSnap::default();
            assert_eq!(snap.update(stick), Some(push));
            assert_eq!(snap.update(stick.perp()), None, "round the rim without rest");
            assert_eq!(snap.pushed(), Some(push));
            snap.update(Vec2::ZERO);
            assert_eq!(snap.pushed(), None);
        }
    }
}
