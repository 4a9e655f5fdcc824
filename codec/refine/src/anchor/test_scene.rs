//! Ray-traced photographs of spheres and capsules, for tests.

use codec::Camera;
use glam::DVec3;

use super::AnchorView;
use super::pinhole::Pinhole;
use crate::fit::Photograph;

/// A capsule, or a sphere if both ends are equal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub(super) ends: [DVec3; 2],
    pub(super) radius: f64,
}

pub(super) fn sphere(center: DVec3, radius: f64) -> Shape {
    Shape { ends: [center; 2], radius }
}

impl Shape {
    /// Depth at which a ray enters the shape.
    fn hit(&self, origin: DVec3, ray: DVec3) -> Option<f64> {
        let ball = |center: DVec3| nearest(origin - center, ray, self.radius);
        let [a, b] = self.ends;
        let axis = (b - a).normalize_or_zero();
        let away = origin - a;
        let side = nearest(away.reject_from(axis_or_x(axis)), ray.reject_from(axis_or_x(axis)), self.radius)
            .filter(|depth| {
                let along = (away + *depth * ray).dot(axis);
                along > 0.0 && along < (b - a).length()
            });
        [ball(a), ball(b), side].into_iter().flatten().reduce(f64::min)
    }

    /// Signed distance of a point from the surface, negative inside.
    pub(super) fn distance(&self, point: DVec3) -> f64 {
        let [a, b] = self.ends;
        let along = (point - a).dot(b - a) / (b - a).length_squared().max(1e-12);
        point.distance(a + along.clamp(0.0, 1.0) * (b - a)) - self.radius
    }
}

fn axis_or_x(axis: DVec3) -> DVec3 {
    if axis == DVec3::ZERO { DVec3::X } else { axis }
}

/// Least positive root of `|away + depth ray| = radius`.
fn nearest(away: DVec3, ray: DVec3, radius: f64) -> Option<f64> {
    let (a, half_b, c) = (ray.dot(ray), away.dot(ray), away.dot(away) - radius * radius);
    let root = (half_b * half_b - a * c).sqrt();
    let depth = (-half_b - root) / a;
    (depth > 0.0).then_some(depth)
}

/// Two rings of cameras at distance `radius` that look at the origin.
pub(super) fn ring(count: usize, radius: f64, size: u32) -> Vec<Camera> {
    let camera = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / count as f64;
        let raised = if i.is_multiple_of(2) { 0.1 } else { 0.5 };
        let (level, up) = (radius * f64::cos(raised), radius * f64::sin(raised));
        let position = [level * angle.sin(), up, level * angle.cos()];
        Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.7, size, size)
    };
    (0..count).map(camera).collect()
}

/// A smooth texture with wavelengths of about 0.05 to 0.1.
pub(super) fn pattern(at: DVec3) -> [u8; 3] {
    let wave = |x: f64, y: f64, z: f64| {
        (80.0 * at.x + x).sin() * (74.0 * at.y + y).sin() + (86.0 * at.z + z).sin() * (130.0 * at.x + y).sin()
    };
    [wave(0.0, 1.0, 2.0), wave(2.0, 0.0, 1.0), wave(1.0, 2.0, 0.0)].map(|w| (128.0 + 60.0 * w) as u8)
}

/// The photograph that `camera` takes of `shapes`, coloured by `color`, and the true depths, 0 for the
/// background.
pub(super) fn view(
    camera_id: usize,
    camera: &Camera,
    shapes: &[Shape],
    color: fn(DVec3) -> [u8; 3],
) -> (AnchorView, Vec<f32>) {
    let pinhole = Pinhole::new(camera);
    let (mut pixels, mut depths) = (Vec::new(), Vec::new());
    for y in 0..camera.height {
        for x in 0..camera.width {
            let ray = pinhole.ray([x, y]);
            let depth = shapes.iter().filter_map(|shape| shape.hit(pinhole.position, ray)).reduce(f64::min);
            let [r, g, b] = depth.map(|depth| color(pinhole.position + depth * ray)).unwrap_or_default();
            pixels.push([r, g, b, if depth.is_some() { 255 } else { 0 }]);
            depths.push(depth.unwrap_or(0.0) as f32);
        }
    }
    let photograph = Photograph { width: camera.width, height: camera.height, pixels, valid: Vec::new() };
    (AnchorView { camera_id, camera: camera.clone(), photograph, depths: None }, depths)
}
