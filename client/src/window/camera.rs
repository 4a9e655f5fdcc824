//! [`CameraControl`]: the camera that the mouse and the keys move.
//!
//! A turntable around a pivot: two angles relative to the clip's up axis, and a distance. Every motion keeps
//! the horizon level. Speeds and limits are relative to the distance between the viewpoint and its target,
//! not to the bounds of the clip, which far outliers of a capture enlarge.

use std::f64::consts::{FRAC_PI_2, PI};

use codec::{Camera, Viewpoint};
use glam::DVec3;

/// Angle of an orbit for a drag over the height of the window.
const TURN_PER_HEIGHT: f64 = PI;

/// Largest pitch: short of the pole, where the yaw is undefined.
const PITCH_MAX: f64 = FRAC_PI_2 - 1e-3;

/// Factor on the distance per notch of the wheel.
pub(crate) const ZOOM_PER_NOTCH: f64 = 0.9;

/// Flying speed per second, relative to the distance to the pivot.
const FLY_PER_SECOND: f64 = 0.4;

/// Factor on the flying speed while shift is held.
const FLY_FAST: f64 = 4.0;

/// The axes that can point up, with their names: those that programs have, first.
const UPS: [(DVec3, &str); 6] = [
    (DVec3::NEG_Y, "-y"),
    (DVec3::Y, "y"),
    (DVec3::Z, "z"),
    (DVec3::NEG_Z, "-z"),
    (DVec3::X, "x"),
    (DVec3::NEG_X, "-x"),
];

/// Direction of flight in camera axes, each -1, 0 or 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Fly {
    pub(crate) right: f64,
    pub(crate) up: f64,
    pub(crate) forward: f64,
    pub(crate) fast: bool,
}

impl Fly {
    /// Whether the direction is not zero.
    pub(crate) fn is_flying(&self) -> bool {
        self.right != 0.0 || self.up != 0.0 || self.forward != 0.0
    }
}

/// A turntable camera.
#[derive(Clone, Debug)]
pub(crate) struct CameraControl {
    /// Unit axes of the clip's world: up, and two horizontal ones.
    up: DVec3,
    north: DVec3,
    east: DVec3,
    /// Distance between the viewpoint visited last and its target.
    scale: f64,
    pivot: DVec3,
    distance: f64,
    yaw: f64,
    pitch: f64,
    fov_y: f64,
}

impl CameraControl {
    /// A camera at `viewpoint` in a world with the up axis `up`.
    pub(crate) fn new(viewpoint: &Viewpoint, up: [f32; 3]) -> CameraControl {
        let up = DVec3::from(up.map(f64::from)).try_normalize().unwrap_or(DVec3::Y);
        let north = up.any_orthonormal_vector();
        let mut control = CameraControl {
            up,
            north,
            east: north.cross(up),
            scale: 1.0,
            pivot: DVec3::ZERO,
            distance: 1.0,
            yaw: 0.0,
            pitch: 0.0,
            fov_y: 1.0,
        };
        control.go_to(viewpoint);
        control
    }

    /// The camera from where it is with the next axis up, and the name of that axis.
    pub(crate) fn with_next_up(&self) -> (CameraControl, &'static str) {
        let nearest = (0..UPS.len()).max_by(|a, b| UPS[*a].0.dot(self.up).total_cmp(&UPS[*b].0.dot(self.up)));
        let (up, name) = UPS[nearest.map_or(0, |at| (at + 1) % UPS.len())];
        (CameraControl::new(&self.viewpoint(), up.as_vec3().to_array()), name)
    }

    /// Whether `up`, of any length, is up.
    pub(crate) fn has_up(&self, up: [f32; 3]) -> bool {
        let up = DVec3::from(up.map(f64::from)).try_normalize().unwrap_or(DVec3::Y);
        up.abs_diff_eq(self.up, 1e-6)
    }

    /// Jumps to a viewpoint. Tilts one that looks along the up axis by less than 0.1 degrees.
    pub(crate) fn go_to(&mut self, viewpoint: &Viewpoint) {
        let position = DVec3::from(viewpoint.position.map(f64::from));
        let target = DVec3::from(viewpoint.target.map(f64::from));
        let ahead = target - position;
        let (distance, forward) = match ahead.try_normalize() {
            Some(forward) => (ahead.length(), forward),
            None => (1.0, self.north),
        };
        (self.scale, self.distance) = (distance, distance);
        self.yaw = forward.dot(self.east).atan2(forward.dot(self.north));
        self.pitch = forward.dot(self.up).clamp(-1.0, 1.0).asin().clamp(-PITCH_MAX, PITCH_MAX);
        self.pivot = position + self.forward() * distance;
        self.fov_y = f64::from(viewpoint.fov_y).clamp(0.01, 3.0);
    }

    /// Turns around the pivot by a drag of `(dx, dy)` window heights; the clip follows the pointer.
    pub(crate) fn orbit(&mut self, dx: f64, dy: f64) {
        self.turn(dx * TURN_PER_HEIGHT, -dy * TURN_PER_HEIGHT);
    }

    /// Turns around the eye by a drag of `(dx, dy)` window heights; a point at the centre of the image stays
    /// under the pointer.
    pub(crate) fn look(&mut self, dx: f64, dy: f64) {
        let position = self.position();
        self.turn(-dx * self.fov_y, dy * self.fov_y);
        self.pivot = position + self.forward() * self.distance;
    }

    fn turn(&mut self, right: f64, up: f64) {
        self.yaw = (self.yaw + right) % (2.0 * PI);
        self.pitch = (self.pitch + up).clamp(-PITCH_MAX, PITCH_MAX);
    }

    /// Moves sideways by a drag of `(dx, dy)` window heights; a point at the distance of the pivot stays
    /// under the pointer.
    pub(crate) fn pan(&mut self, dx: f64, dy: f64) {
        let height = 2.0 * self.distance * (0.5 * self.fov_y).tan();
        let right = self.right();
        let up = right.cross(self.forward());
        self.pivot += (up * dy - right * dx) * height;
    }

    /// Moves towards the pivot by `notches` of the wheel; negative ones move away.
    pub(crate) fn zoom(&mut self, notches: f64) {
        let distance = self.distance * ZOOM_PER_NOTCH.powf(notches);
        // Nearer, rounding shows; farther, the clip is too small to return to.
        self.distance = distance.clamp(1e-2 * self.scale, 1e2 * self.scale);
    }

    /// Flies for `elapsed_s` seconds.
    pub(crate) fn fly(&mut self, fly: Fly, elapsed_s: f64) {
        let direction = self.right() * fly.right + self.up * fly.up + self.forward() * fly.forward;
        let speed = FLY_PER_SECOND * self.distance * if fly.fast { FLY_FAST } else { 1.0 };
        self.pivot += direction.normalize_or_zero() * speed * elapsed_s;
    }

    /// The camera for a window of `width` x `height` pixels.
    pub(crate) fn camera(&self, width: u32, height: u32) -> Camera {
        let (position, up) = (self.position().to_array(), self.up.to_array());
        Camera::look_at(position, self.pivot.to_array(), up, self.fov_y, width, height)
    }

    /// Where the camera is, and what it turns around.
    pub(crate) fn viewpoint(&self) -> Viewpoint {
        Viewpoint {
            name: String::new(),
            position: self.position().as_vec3().to_array(),
            target: self.pivot.as_vec3().to_array(),
            fov_y: self.fov_y as f32,
        }
    }

    fn position(&self) -> DVec3 {
        self.pivot - self.forward() * self.distance
    }

    fn forward(&self) -> DVec3 {
        let ground = self.north * self.yaw.cos() + self.east * self.yaw.sin();
        ground * self.pitch.cos() + self.up * self.pitch.sin()
    }

    fn right(&self) -> DVec3 {
        self.forward().cross(self.up).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: u32 = 640;
    const HEIGHT: u32 = 480;

    fn viewpoint() -> Viewpoint {
        Viewpoint { name: "front".into(), position: [0.0, 1.0, 4.0], target: [0.0, 1.0, 0.0], fov_y: 0.9 }
    }

    fn control() -> CameraControl {
        CameraControl::new(&viewpoint(), [0.0, 1.0, 0.0])
    }

    /// Pixel of a world point.
    fn project(camera: &Camera, point: DVec3) -> [f64; 2] {
        let m = &camera.camera_from_world;
        let row = |r: usize| m[r][0] * point.x + m[r][1] * point.y + m[r][2] * point.z + m[r][3];
        let (x, y, z) = (row(0), row(1), row(2));
        [camera.k[0][0] * x / z + camera.k[0][2], camera.k[1][1] * y / z + camera.k[1][2]]
    }

    fn near(a: DVec3, b: DVec3) -> bool {
        (a - b).length() < 1e-6
    }

    #[test]
    fn it_starts_at_the_viewpoint() {
        for up in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.8, 0.0]] {
            let viewpoint = Viewpoint { position: [1.0, 2.0, 3.0], target: [-2.0, 0.5, 0.0], ..viewpoint() };
            let control = CameraControl::new(&viewpoint, up);
            let (ours, theirs) = (control.camera(WIDTH, HEIGHT), viewpoint.camera(up, WIDTH, HEIGHT));
            let differences = ours
                .camera_from_world
                .iter()
                .flatten()
                .zip(theirs.camera_from_world.iter().flatten())
                .map(|(a, b)| (a - b).abs());
            assert!(differences.fold(0.0, f64::max) < 1e-6, "{ours:?} {theirs:?}");
            assert_eq!(ours.k, theirs.k);
        }
    }

    #[test]
    fn any_axis_can_be_turned_up() {
        let viewpoint = Viewpoint { position: [1.0, 2.0, 3.0], target: [-2.0, 0.5, 0.0], ..viewpoint() };
        let mut control = CameraControl::new(&viewpoint, [0.0, -1.0, 0.0]);
        for expected in ["y", "z", "-z", "x", "-x", "-y"] {
            let (next, name) = control.with_next_up();
            assert_eq!(name, expected);
            assert!((next.position() - control.position()).length() < 1e-9, "the eye stays");
            control = next;
        }
        // Between axes, the nearest is left.
        let tilted = CameraControl::new(&viewpoint, [0.1, -0.9, 0.2]);
        assert_eq!(tilted.with_next_up().1, "y");
    }

    #[test]
    fn an_orbit_keeps_the_pivot_centred_at_its_distance() {
        let mut control = control();
        control.orbit(0.3, 0.2);
        assert!(near(control.pivot, DVec3::new(0.0, 1.0, 0.0)));
        assert!((control.position().distance(control.pivot) - 4.0).abs() < 1e-9);
        let [x, y] = project(&control.camera(WIDTH, HEIGHT), control.pivot);
        assert!((x - 320.0).abs() < 1e-6 && (y - 240.0).abs() < 1e-6);
    }

    #[test]
    fn the_near_side_follows_a_drag() {
        let near_side = DVec3::new(0.0, 1.0, 1.0);
        for (dx, dy) in [(0.05, 0.0), (-0.05, 0.0), (0.0, 0.05), (0.0, -0.05)] {
            let mut control = control();
            control.orbit(dx, dy);
            let [x, y] = project(&control.camera(WIDTH, HEIGHT), near_side);
            let moved = if dx != 0.0 { (x - 320.0) / dx } else { (y - 240.0) / dy };
            assert!(moved > 1.0, "drag {dx} {dy} moved it to {x} {y}");
        }
    }

    #[test]
    fn looking_keeps_the_eye_and_the_image_follows_the_pointer() {
        let mut control = control();
        let eye = control.position();
        control.look(0.02, 0.03);
        assert!(near(control.position(), eye));
        let [x, y] = project(&control.camera(WIDTH, HEIGHT), DVec3::new(0.0, 1.0, 0.0));
        let expected = [320.0 + 0.02 * 480.0, 240.0 + 0.03 * 480.0];
        assert!((x - expected[0]).abs() < 2.0 && (y - expected[1]).abs() < 2.0, "{x} {y}");
    }

    #[test]
    fn a_pan_holds_the_point_under_the_pointer() {
        let mut control = control();
        let point = control.pivot;
        control.pan(0.25, -0.1);
        let [x, y] = project(&control.camera(WIDTH, HEIGHT), point);
        assert!((x - (320.0 + 0.25 * 480.0)).abs() < 1e-6 && (y - (240.0 - 0.1 * 480.0)).abs() < 1e-6);
    }

    #[test]
    fn the_wheel_moves_to_the_pivot_and_never_through_it() {
        let mut control = control();
        control.zoom(3.0);
        assert!((control.distance - 4.0 * 0.729).abs() < 1e-9);
        control.zoom(-3.0);
        assert!((control.distance - 4.0).abs() < 1e-9);
        control.zoom(1e6);
        assert!(control.distance > 0.0 && control.camera(WIDTH, HEIGHT).check().is_ok());
        control.zoom(-1e6);
        assert!(control.distance.is_finite() && control.camera(WIDTH, HEIGHT).check().is_ok());
    }

    #[test]
    fn flying_follows_the_camera_axes_at_the_scale_of_the_view() {
        let mut control = control();
        let eye = control.position();
        control.fly(Fly { forward: 1.0, ..Fly::default() }, 2.0);
        assert!(near(control.position() - eye, DVec3::new(0.0, 0.0, -3.2)));
        control.fly(Fly { right: 1.0, fast: true, ..Fly::default() }, 0.5);
        assert!(near(control.position() - eye, DVec3::new(3.2, 0.0, -3.2)));
        control.fly(Fly { up: -1.0, ..Fly::default() }, 1.0);
        assert!(near(control.position() - eye, DVec3::new(3.2, -1.6, -3.2)));
    }

    #[test]
    fn the_camera_is_valid_at_the_poles() {
        let mut control = control();
        for dy in [5.0, -10.0] {
            control.orbit(0.0, dy);
            let camera = control.camera(WIDTH, HEIGHT);
            assert!(camera.check().is_ok());
            // Upright: the image's downward axis still points below the horizon.
            assert!(camera.camera_from_world[1][1] < 0.0);
        }
        let along_up = Viewpoint { position: [0.0, 5.0, 0.0], target: [0.0; 3], ..viewpoint() };
        let control = CameraControl::new(&along_up, [0.0, 1.0, 0.0]);
        assert!(control.camera(WIDTH, HEIGHT).check().is_ok());
        assert!((control.position() - DVec3::new(0.0, 5.0, 0.0)).length() < 1e-6);
    }

    #[test]
    fn a_viewpoint_without_a_direction_has_a_valid_camera() {
        let nowhere = Viewpoint { position: [1.0; 3], target: [1.0; 3], ..viewpoint() };
        let control = CameraControl::new(&nowhere, [0.0; 3]);
        assert!(control.camera(WIDTH, HEIGHT).check().is_ok());
    }
}
