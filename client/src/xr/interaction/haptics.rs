//! [`Haptics`]: what the hands are to feel in a frame.

use super::hands::Side;

/// A short vibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// From 0 to 1.
    pub amplitude: f32,
    /// Length in seconds.
    pub duration_s: f32,
}

impl Pulse {
    /// A hand takes hold of the clip.
    pub const GRAB: Pulse = Pulse { amplitude: 0.6, duration_s: 0.03 };
    /// It lets go.
    pub const RELEASE: Pulse = Pulse { amplitude: 0.3, duration_s: 0.02 };
    /// The viewer turned by a step.
    pub const SNAP: Pulse = Pulse { amplitude: 0.4, duration_s: 0.02 };
    /// Something on the panel was pressed.
    pub const PRESS: Pulse = Pulse { amplitude: 0.25, duration_s: 0.012 };
}

/// At most a pulse for each hand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Haptics {
    pulses: [Option<Pulse>; 2],
}

impl Haptics {
    /// Asks for a pulse; the stronger one of two counts.
    pub fn play(&mut self, side: Side, pulse: Pulse) {
        let slot = &mut self.pulses[side as usize];
        if slot.is_none_or(|other| other.amplitude < pulse.amplitude) {
            *slot = Some(pulse);
        }
    }

    /// What a hand is to feel.
    pub fn on(&self, side: Side) -> Option<Pulse> {
        self.pulses[side as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stronger_pulse_counts() {
        let mut haptics = Haptics::default();
        for pulse in [Pulse::RELEASE, Pulse::GRAB, Pulse::PRESS] {
            haptics.play(Side::Left, pulse);
        }
        assert_eq!([haptics.on(Side::Left), haptics.on(Side::Right)], [Some(Pulse::GRAB), None]);
    }
}
