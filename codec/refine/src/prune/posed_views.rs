//! [`PosedView`]s to rank and compare fields by.
//!
//! If a source suggests viewpoints, they are used together with cameras slightly aside, since a head
//! moves. Otherwise virtual cameras are placed on a dome around the subject.

use codec::{ALPHA_MIN, Camera, Field, Viewpoint, Visibility};
use glam::{DQuat, DVec3};

use super::extent::core_box;
use crate::reference::{Shown, shown};

/// A picture to take.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedView {
    /// From where, and how large.
    pub camera: Camera,
    /// When, in clip time.
    pub t: f64,
}

/// Vertical field of view of the dome's cameras, in degrees.
const DOME_FOV_Y: f64 = 50.0;

/// The dome's rings: elevation in degrees, number of cameras.
const DOME_RINGS: [(f64, u32); 2] = [(10.0, 5), (45.0, 3)];

/// Width and height in pixels of the pictures that tell whether a view is informative.
const PROBE: (u32, u32) = (64, 48);

/// Vertical field of view of the cameras inside a field, in degrees, and their number.
const INSIDE_FOV_Y: f64 = 75.0;
const INSIDE_CAMERAS: u32 = 4;

/// A field surrounds its centre where cameras there see it from at least this distance on average, in units
/// of its radius: walls are near it, the inside of a body's surface is at a fifth.
const INSIDE_DEPTH_MIN: f64 = 0.35;

/// Whether `view` shows enough of `field` to compare pictures by: not empty space, and not the inside of one
/// Gaussian. A camera that fails [`Camera::check`] shows nothing.
pub fn is_informative(field: &Field, view: &PosedView) -> bool {
    informative_depth(field, view).is_some()
}

/// Mean depth of what an informative view shows; `None` for any other view.
fn informative_depth(field: &Field, PosedView { camera, t }: &PosedView) -> Option<f64> {
    let alive = (0..field.len()).filter(|&row| field.opacity_at(row, *t) >= ALPHA_MIN).count();
    let camera = camera.resized(PROBE.0, PROBE.1);
    camera.check().ok()?;
    let Shown { covered, gaussians, largest_share, depth } = shown(field, &camera, *t);
    Visibility { alive, gaussians, covered, largest_share }.is_informative().then_some(depth)
}

/// Views of every camera at every instant, in clip time.
pub fn posed_views(cameras: &[Camera], instants: &[f64]) -> Vec<PosedView> {
    let view = |camera: &Camera, t| PosedView { camera: camera.clone(), t };
    instants.iter().flat_map(|&t| cameras.iter().map(move |camera| view(camera, t))).collect()
}

/// The centres of `count` equal intervals of the clip; only the start if `field` is static.
pub fn instants(field: &Field, count: usize) -> Vec<f64> {
    match field.temporal {
        Some(_) => (0..count).map(|i| (i as f64 + 0.5) / count as f64).collect(),
        None => vec![0.0],
    }
}

/// Five cameras of `size` pixels that look at the target of `viewpoint`: one at its position, the others
/// turned around the target by `angle` radians to the left, right, top and bottom.
pub fn steps_aside(viewpoint: &Viewpoint, up: [f32; 3], angle: f64, size: (u32, u32)) -> Vec<Camera> {
    let target = DVec3::from_array(viewpoint.target.map(f64::from));
    let arm = DVec3::from_array(viewpoint.position.map(f64::from)) - target;
    let up = DVec3::from_array(up.map(f64::from)).normalize_or(DVec3::Y);
    let across = arm.cross(up).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let turns = [(up, 0.0), (up, angle), (up, -angle), (across, angle), (across, -angle)];
    let camera = |(axis, angle): (DVec3, f64)| {
        let (sin, cos) = libm::sincos(0.5 * angle);
        let turn = DQuat::from_xyzw(sin * axis.x, sin * axis.y, sin * axis.z, cos);
        let position = target + turn * arm;
        let fov_y = f64::from(viewpoint.fov_y);
        Camera::look_at(position.to_array(), target.to_array(), up.to_array(), fov_y, size.0, size.1)
    };
    turns.map(camera).to_vec()
}

/// Eight cameras of `size` pixels on two rings around `field` at `instants`; each sees the whole field
/// except outliers. `turn` rotates the rings, in units of the angle between neighbouring cameras.
pub fn dome(field: &Field, instants: &[f64], up: [f32; 3], turn: f64, size: (u32, u32)) -> Vec<Camera> {
    let [low, high] = core_box(field, instants).unwrap_or_default();
    let center = 0.5 * (low + high);
    let radius = 0.5 * (high - low).length();
    let half_fov = 0.5 * DOME_FOV_Y.to_radians();
    // A field in a single point is seen from a distance of 1.
    let distance = if radius > 0.0 { radius / libm::sin(half_fov) } else { 1.0 };
    let up = DVec3::from_array(up.map(f64::from)).normalize_or(DVec3::Y);
    let (right, forward) = up.any_orthonormal_pair();
    let mut cameras = Vec::new();
    for (elevation, count) in DOME_RINGS {
        for i in 0..count {
            let azimuth = std::f64::consts::TAU * (f64::from(i) + turn) / f64::from(count);
            let (sin, cos) = libm::sincos(elevation.to_radians());
            let (across, along) = libm::sincos(azimuth);
            let direction = cos * (along * forward + across * right) + sin * up;
            let position = (center + distance * direction).to_array();
            let fov_y = 2.0 * half_fov;
            cameras.push(Camera::look_at(position, center.to_array(), up.to_array(), fov_y, size.0, size.1));
        }
    }
    cameras
}

/// Four cameras of `size` pixels at the centre of `field`, which look around; none if the field does not
/// surround its centre at some distance at the first of `instants`, as a room does and a body does not.
/// `turn` rotates them, in units of the angle between neighbouring cameras.
pub fn inside(field: &Field, instants: &[f64], up: [f32; 3], turn: f64, size: (u32, u32)) -> Vec<Camera> {
    let Some([low, high]) = core_box(field, instants) else { return Vec::new() };
    let (center, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    let up = DVec3::from_array(up.map(f64::from)).normalize_or(DVec3::Y);
    let (right, forward) = up.any_orthonormal_pair();
    let camera = |i: u32| {
        let azimuth = std::f64::consts::TAU * (f64::from(i) + turn) / f64::from(INSIDE_CAMERAS);
        let (across, along) = libm::sincos(azimuth);
        let target = center + radius.max(f64::MIN_POSITIVE) * (along * forward + across * right);
        let fov_y = INSIDE_FOV_Y.to_radians();
        Camera::look_at(center.to_array(), target.to_array(), up.to_array(), fov_y, size.0, size.1)
    };
    let cameras: Vec<Camera> = (0..INSIDE_CAMERAS).map(camera).collect();
    let sees_walls = |camera: &&Camera| {
        let view = PosedView { camera: (*camera).clone(), t: instants[0] };
        informative_depth(field, &view).is_some_and(|depth| depth >= INSIDE_DEPTH_MIN * radius)
    };
    // A room may be open to one side.
    let walls = cameras.iter().filter(sees_walls).count();
    if walls + 1 >= INSIDE_CAMERAS as usize { cameras } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::balls;

    #[test]
    fn every_camera_of_the_dome_sees_the_field_without_outliers() {
        let mut centers = Vec::new();
        for i in 0..200 {
            let a = f64::from(i) * 0.7;
            centers.push([
                (10.0 + a.sin()) as f32,
                (3.0 + 2.0 * (a * 0.3).cos()) as f32,
                (a * 0.9).sin() as f32,
            ]);
        }
        centers.push([1e6, 0.0, 0.0]);
        let field = balls(&centers, 0.1, 0.9);
        let cameras = dome(&field, &[0.0], [0.0, 0.0, 1.0], 0.5, (120, 90));
        assert_eq!(cameras.len(), 8);
        for camera in &cameras {
            camera.check().unwrap();
            assert!(camera.position()[2] > 0.1, "above the center of the field");
            let m = &camera.camera_from_world;
            for center in &centers[..200] {
                let [x, y, z] = [0, 1, 2]
                    .map(|r| (0..3).map(|axis| m[r][axis] * f64::from(center[axis])).sum::<f64>() + m[r][3]);
                let (x, y) =
                    (camera.k[0][0] * x / z + camera.k[0][2], camera.k[1][1] * y / z + camera.k[1][2]);
                assert!(z > 0.0 && (0.0..120.0).contains(&x) && (0.0..90.0).contains(&y), "{x} {y} {z}");
            }
        }
    }

    #[test]
    fn degenerate_fields_and_axes_still_get_cameras() {
        for field in [balls(&[], 0.1, 0.9), balls(&[[1.0; 3]], 0.1, 0.9), balls(&[[1.0; 3]], 0.1, 0.0)] {
            for up in [[0.0, 1.0, 0.0], [0.0; 3]] {
                assert!(dome(&field, &[0.0], up, 0.0, (8, 8)).iter().all(|camera| camera.check().is_ok()));
            }
        }
        let viewpoint =
            Viewpoint { name: "top".into(), position: [0.0, 5.0, 0.0], target: [0.0; 3], fov_y: 1.0 };
        let cameras = steps_aside(&viewpoint, [0.0, 1.0, 0.0], 0.1, (8, 8));
        assert!(cameras.iter().all(|camera| camera.check().is_ok()));
    }

    #[test]
    fn steps_aside_preserve_distance_and_target() {
        let viewpoint =
            Viewpoint { name: "v".into(), position: [1.0, 2.0, 5.0], target: [1.0, 1.0, 0.0], fov_y: 0.8 };
        let up = [0.0, 1.0, 0.0];
        let cameras = steps_aside(&viewpoint, up, 0.2, (64, 48));
        assert_eq!(cameras[0], viewpoint.camera(up, 64, 48));
        let target = DVec3::new(1.0, 1.0, 0.0);
        let arm = |camera: &Camera| DVec3::from_array(camera.position()) - target;
        for camera in &cameras[1..] {
            assert!((arm(camera).length() - arm(&cameras[0]).length()).abs() < 1e-6);
        }
        assert!((arm(&cameras[3]).angle_between(arm(&cameras[0])) - 0.2).abs() < 1e-6);
        assert!((arm(&cameras[1]) - arm(&cameras[2])).length() > 1.0);
    }

    /// Points on a sphere, evenly.
    fn sphere(count: usize, radius: f64) -> Vec<[f32; 3]> {
        let point = |i: usize| {
            let height = 1.0 - (2 * i + 1) as f64 / count as f64;
            let (sin, cos) = libm::sincos(2.399_963 * i as f64);
            let level = (1.0 - height * height).sqrt();
            [level * cos, height, level * sin].map(|x| (radius * x) as f32)
        };
        (0..count).map(point).collect()
    }

    fn gaze(camera: &Camera) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|axis| camera.camera_from_world[2][axis]))
    }

    #[test]
    fn instants_are_centres_of_intervals() {
        let mut field = balls(&[[0.0; 3]], 0.1, 0.9);
        assert_eq!(instants(&field, 4), [0.0]);
        field.temporal = Some(codec::Temporal { tau: vec![0.5], s: vec![1.0], ..Default::default() });
        assert_eq!(instants(&field, 4), [0.125, 0.375, 0.625, 0.875]);
    }

    #[test]
    fn the_dome_has_two_even_rings() {
        let center = DVec3::new(5.0, 0.0, -3.0);
        let place = |[x, y, z]: [f32; 3]| [x + 5.0, y, z - 3.0];
        let field = balls(&sphere(300, 2.0).into_iter().map(place).collect::<Vec<_>>(), 0.1, 0.9);
        let directions = |turn: f64| -> Vec<DVec3> {
            let cameras = dome(&field, &[0.0], [0.0, 1.0, 0.0], turn, (8, 8));
            let direction = |camera: &Camera| {
                let away = DVec3::from_array(camera.position()) - center;
                // The corners of the box are 3.5 from the centre.
                assert!((7.0..9.0).contains(&away.length()), "{away}");
                -gaze(camera)
            };
            cameras.iter().map(direction).collect()
        };
        let (rings, turned) = (directions(0.0), directions(0.5));
        for (ring, elevation, count) in [(0..5, 10.0_f64, 5), (5..8, 45.0, 3)] {
            let step = std::f64::consts::TAU / f64::from(count);
            let level = |direction: DVec3| (direction - direction.y * DVec3::Y).normalize();
            for i in ring.clone() {
                let next = if i + 1 == ring.end { ring.start } else { i + 1 };
                assert!((rings[i].y - elevation.to_radians().sin()).abs() < 1e-6, "{}", rings[i]);
                let [to_next, to_turned] =
                    [rings[next], turned[i]].map(|other| level(rings[i]).angle_between(level(other)));
                assert!((to_next - step).abs() < 1e-6 && (to_turned - 0.5 * step).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn steps_aside_go_to_all_four_sides() {
        let viewpoint =
            Viewpoint { name: "v".into(), position: [0.0, 0.0, 5.0], target: [0.0; 3], fov_y: 0.8 };
        let cameras = steps_aside(&viewpoint, [0.0, 1.0, 0.0], 0.2, (64, 48));
        let step = 5.0 * 0.2_f64.sin();
        let mut sides: Vec<[i32; 2]> = cameras[1..]
            .iter()
            .map(|camera| [0, 1].map(|axis| (camera.position()[axis] / step).round() as i32))
            .collect();
        sides.sort_unstable();
        assert_eq!(sides, [[-1, 0], [0, -1], [0, 1], [1, 0]]);
    }

    /// A room, one that is open to a side, and a body whose inside the centre is.
    #[test]
    fn cameras_inside_look_around_in_a_room_only() {
        let up = [0.0, 1.0, 0.0];
        let cameras = |centers: &[[f32; 3]]| inside(&balls(centers, 0.15, 0.9), &[0.0], up, 0.0, (64, 48));
        let walls = sphere(4000, 3.0);
        let room = cameras(&walls);
        assert_eq!(room.len(), 4);
        for (i, camera) in room.iter().enumerate() {
            assert!(DVec3::from_array(camera.position()).length() < 0.2, "{:?}", camera.position());
            let next = gaze(&room[(i + 1) % 4]);
            assert!(gaze(camera).dot(next).abs() < 1e-6 && gaze(camera).y.abs() < 1e-6);
        }
        let turned = inside(&balls(&walls, 0.15, 0.9), &[0.0], up, 0.5, (64, 48));
        let angle = gaze(&turned[0]).angle_between(gaze(&room[0]));
        assert!((angle - std::f64::consts::FRAC_PI_4).abs() < 1e-6, "{angle}");
        // The extents of the room stay: only what the camera sees goes.
        let side = gaze(&room[0]);
        let is_left = |point: &&[f32; 3]| {
            DVec3::from_array(point.map(f64::from)).normalize().dot(side) < 0.55 || point[1].abs() > 2.6
        };
        let open: Vec<[f32; 3]> = walls.iter().filter(is_left).copied().collect();
        assert!(open.len() < walls.len() - 500);
        assert_eq!(cameras(&open).len(), 4, "open to one side");
        let body: Vec<[f32; 3]> = (1..=10).flat_map(|i| sphere(60 * i, 0.3 * i as f64)).collect();
        assert!(cameras(&body).is_empty());
        assert!(cameras(&[]).is_empty());
    }

    #[test]
    fn a_view_counts_if_it_shows_enough() {
        let field = balls(&sphere(400, 2.0), 0.1, 0.9);
        let view = |field: &Field, target: [f64; 3]| {
            let camera = Camera::look_at([0.0, 0.0, 8.0], target, [0.0, 1.0, 0.0], 0.8, 320, 240);
            is_informative(field, &PosedView { camera, t: 0.0 })
        };
        assert!(view(&field, [0.0; 3]));
        assert!(!view(&field, [0.0, 0.0, 20.0]), "it looks away");
        let mut before_the_lens = field.clone();
        before_the_lens.centers[0] = [0.0, 0.0, 7.0];
        before_the_lens.log_scales[0] = [-0.7; 3];
        assert!(!view(&before_the_lens, [0.0; 3]), "the inside of one Gaussian");
        let few = balls(&sphere(3, 1.0), 0.3, 0.9);
        assert!(view(&few, [0.0; 3]), "a field of few Gaussians, all of them");
    }
}
