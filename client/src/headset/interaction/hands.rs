//! [`Hands`]: both hands in a frame, as the runtime reports them, in metres of the stage: +y up, the floor at
//! 0, -z ahead.

use glam::{DVec3, Quat, Vec2, Vec3};

/// Farthest distance of a plausible pose from the origin of the stage, in metres.
const FARTHEST_M: f32 = 100.0;

/// Position and orientation in the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// In metres.
    pub position: Vec3,
    /// Unit quaternion from the local axes: -z ahead, +y up.
    pub orientation: Quat,
}

impl Pose {
    /// At the origin, looking along -z.
    pub const IDENTITY: Pose = Pose { position: Vec3::ZERO, orientation: Quat::IDENTITY };

    /// Whether the pose is plausible: finite, near enough to be in a room, and not scaled.
    pub fn is_valid(&self) -> bool {
        // A comparison with NaN is false.
        self.position.length_squared() <= FARTHEST_M * FARTHEST_M
            && (self.orientation.length_squared() - 1.0).abs() < 0.01
    }

    /// Unit vector of the local -z axis.
    pub fn forward(&self) -> Vec3 {
        self.orientation * Vec3::NEG_Z
    }

    /// Angle about +y from looking along -z, in radians; defined also for a pose that looks straight up or
    /// down.
    pub fn heading(&self) -> f64 {
        let (forward, up) = (self.forward(), self.orientation * Vec3::Y);
        // For a viewer who looks down, the head's up axis points ahead; for one who looks up, back.
        let ahead = (forward - up * forward.y).as_dvec3();
        if DVec3::new(ahead.x, 0.0, ahead.z).length_squared() > 1e-12 {
            (-ahead.x).atan2(-ahead.z)
        } else {
            0.0
        }
    }
}

impl Default for Pose {
    fn default() -> Pose {
        Pose::IDENTITY
    }
}

/// One of two hands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The left hand, index 0 in arrays.
    Left,
    /// The right hand, index 1.
    Right,
}

impl Side {
    /// Both sides in the order of arrays.
    pub const BOTH: [Side; 2] = [Side::Left, Side::Right];

    /// The other hand.
    pub fn other(self) -> Side {
        match self {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        }
    }
}

/// A button of a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// The trigger; a pinch of a bare hand.
    Select,
    /// The grip below the middle finger.
    Squeeze,
    /// The lower of two buttons beside the stick: X on the left, A on the right.
    Primary,
    /// The upper of the two: Y on the left, B on the right.
    Secondary,
    /// The menu button, on controllers that do not reserve it for the system.
    Menu,
}

impl Button {
    /// All buttons in the order of arrays.
    pub(super) const ALL: [Button; 5] =
        [Button::Select, Button::Squeeze, Button::Primary, Button::Secondary, Button::Menu];
}

/// A hand with its controller, as the runtime reports it. Buttons that a controller lacks stay released.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hand {
    /// Whether both poses are known now.
    pub tracked: bool,
    /// Origin and direction of the pointer ray.
    pub aim: Pose,
    /// Pose of the palm.
    pub grip: Pose,
    /// [`Button::Select`].
    pub select: bool,
    /// [`Button::Squeeze`].
    pub squeeze: bool,
    /// Deflection to the right and up, each -1 to 1.
    pub stick: Vec2,
    /// [`Button::Primary`].
    pub primary: bool,
    /// [`Button::Secondary`].
    pub secondary: bool,
    /// [`Button::Menu`].
    pub menu: bool,
}

impl Hand {
    /// Whether `button` is down.
    pub(super) fn is_down(&self, button: Button) -> bool {
        match button {
            Button::Select => self.select,
            Button::Squeeze => self.squeeze,
            Button::Primary => self.primary,
            Button::Secondary => self.secondary,
            Button::Menu => self.menu,
        }
    }
}

/// Both hands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hands {
    /// The left one.
    pub left: Hand,
    /// The right one.
    pub right: Hand,
}

impl Hands {
    /// The hand on one side.
    pub(super) fn on(&self, side: Side) -> &Hand {
        match side {
            Side::Left => &self.left,
            Side::Right => &self.right,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use super::*;

    fn looking(heading: f32, pitch: f32) -> Pose {
        Pose {
            position: Vec3::ZERO,
            orientation: Quat::from_rotation_y(heading) * Quat::from_rotation_x(pitch),
        }
    }

    #[test]
    fn the_heading_is_stable_while_looking_up_and_down() {
        for heading in [-3.0, -1.0, 0.0, 0.7, 2.5] {
            for pitch in [-FRAC_PI_2, -1.2, 0.0, 0.9, FRAC_PI_2] {
                let found = looking(heading, pitch).heading();
                assert!((found - f64::from(heading)).abs() < 1e-3, "{heading} {pitch}: {found}");
            }
        }
    }

    #[test]
    fn implausible_poses_are_found() {
        let pose = looking(1.0, 0.3);
        assert!(pose.is_valid() && Pose::IDENTITY.is_valid());
        for position in [Vec3::NAN, Vec3::X * f32::INFINITY, Vec3::Y * 1e4] {
            assert!(!Pose { position, ..pose }.is_valid());
        }
        for orientation in [Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0)] {
            assert!(!Pose { orientation, ..pose }.is_valid());
        }
    }
}
