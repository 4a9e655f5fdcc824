//! [`Haptics`]: the vibrations of a frame.

use super::hands::Side;

/// A short vibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// Strength, 0 to 1.
    pub amplitude: f32,
    /// Length in seconds.
    pub duration_s: f32,
}

impl Pulse {
    /// A hand takes hold of the clip.
    pub const GRAB: Pulse = Pulse { amplitude: 0.6, duration_s: 0.03 };
    /// A hand releases the clip.
    pub const RELEASE: Pulse = Pulse { amplitude: 0.3, duration_s: 0.02 };
    /// The viewer turns by a step.
    pub const SNAP: Pulse = Pulse { amplitude: 0.4, duration_s: 0.02 };
    /// A hand presses on the panel.
    pub const PRESS: Pulse = Pulse { amplitude: 0.25, duration_s: 0.012 };
}

/// At most one pulse for each hand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Haptics {
    pulses: [Option<Pulse>; 2],
}

impl Haptics {
    /// Adds a pulse; of two for a hand, the stronger one wins.
    pub fn play(&mut self, side: Side, pulse: Pulse) {
        let slot = &mut self.pulses[side as usize];
        if slot.is_none_or(|other| other.amplitude < pulse.amplitude) {
            *slot = Some(pulse);
        }
    }

    /// Pulse of a hand.
    pub fn on(&self, side: Side) -> Option<Pulse> {
        self.pulses[side as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stronger_pulse_wins() {
        let mut haptics = Haptics::default();
        for pulse in [Pulse::RELEASE, Pulse::GRAB, Pulse::PRESS] {
            haptics.play(Side::Left, pulse);
        }
        assert_eq!([haptics.on(Side::Left), haptics.on(Side::Right)], [Some(Pulse::GRAB), None]);
    }
}
