//! [`PanelQuad`]: the surface of the panel in the stage, and its intersections with rays.

use egui::{Pos2, Vec2 as Points, pos2, vec2};
use glam::{Mat3, Quat, Vec2, Vec3};

use crate::headset::interaction::Pose;

/// Size of the panel in points; a point is a millimetre.
pub const SIZE: Points = vec2(820.0, 720.0);

/// Height of the console, its permanent lower part, in points.
pub(super) const CONSOLE_HEIGHT: f32 = 352.0;

/// Pixels of the image per point: about the resolution of a headset of 2023 at this distance.
pub const PIXELS_PER_POINT: f32 = 1.5;

const METRES_PER_POINT: f32 = 1e-3;

/// Distance of the console's center ahead of the eyes and below them, in metres: like a lectern at 1.2 m, which
/// hides only the legs of a person in front.
const AHEAD_M: f32 = 1.0;
const BELOW_M: f32 = 0.62;

/// Least height of that center above the floor, for viewers who sit on it, and least distance below the eyes,
/// in metres.
const FLOOR_M: f32 = 0.35;
const BELOW_LEAST_M: f32 = 0.3;

/// A quad of [`SIZE`], visible from the side of its +z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PanelQuad {
    /// Pose of its center, with x to the right and y up along it.
    pose: Pose,
}

/// Intersection of a ray and the plane of a quad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    /// Position in points from the upper left corner; may be outside.
    pub(super) at: Pos2,
    /// Distance from the origin of the ray in metres.
    pub(super) distance_m: f32,
}

impl PanelQuad {
    /// A quad in front of a viewer with the head at `head`, tilted towards the eyes.
    pub fn before(head: &Pose) -> PanelQuad {
        let turn = Quat::from_rotation_y(head.heading() as f32);
        let eye = head.position;
        let height = (eye.y - BELOW_M).max(FLOOR_M.min(eye.y - BELOW_LEAST_M));
        let console = Vec3 { y: height, ..eye } + turn * Vec3::new(0.0, 0.0, -AHEAD_M);
        let right = turn * Vec3::X;
        let normal = (eye - console).normalize();
        let up = normal.cross(right);
        let above = 0.5 * (SIZE.y - CONSOLE_HEIGHT) * METRES_PER_POINT;
        let orientation = Quat::from_mat3(&Mat3::from_cols(right, up, normal));
        PanelQuad { pose: Pose { position: console + up * above, orientation } }
    }

    /// Pose of the quad layer: the center, with +x to its right, +y up along it, and +z to the viewer.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Width and height in metres.
    pub fn size_m(&self) -> Vec2 {
        Vec2::new(SIZE.x, SIZE.y) * METRES_PER_POINT
    }

    /// Intersection with the ray along -z of `ray`; `None` for a ray that misses or comes from behind.
    pub(super) fn hit(&self, ray: &Pose) -> Option<Hit> {
        let quad_from_stage = self.pose.orientation.inverse();
        let origin = quad_from_stage * (ray.position - self.pose.position);
        let direction = quad_from_stage * ray.forward();
        let distance_m = origin.z / -direction.z;
        let meets = origin.z > 0.0 && direction.z < 0.0 && distance_m.is_finite();
        meets.then(|| {
            let point = (origin + direction * distance_m) / METRES_PER_POINT;
            Hit { at: pos2(0.5 * SIZE.x + point.x, 0.5 * SIZE.y - point.y), distance_m }
        })
    }

    /// The point of the stage at `at` points from the upper left corner.
    #[cfg(test)]
    pub(super) fn stage_point(&self, at: Pos2) -> Vec3 {
        let offset = Vec3::new(at.x - 0.5 * SIZE.x, 0.5 * SIZE.y - at.y, 0.0) * METRES_PER_POINT;
        self.pose.position + self.pose.orientation * offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(height: f32, heading: f32) -> Pose {
        Pose { position: Vec3::new(0.5, height, 2.0), orientation: Quat::from_rotation_y(heading) }
    }

    /// A ray from `origin` to `target`.
    fn ray(origin: Vec3, target: Vec3) -> Pose {
        let direction = (target - origin).normalize();
        Pose { position: origin, orientation: Quat::from_rotation_arc(Vec3::NEG_Z, direction) }
    }

    #[test]
    fn the_quad_is_ahead_below_eye_level_and_faces_the_eyes() {
        for (height, heading) in [(1.7, 0.0), (1.2, 2.0), (0.3, -1.0), (0.0, 3.0)] {
            let head = head(height, heading);
            let quad = PanelQuad::before(&head);
            let console = quad.stage_point(pos2(0.5 * SIZE.x, SIZE.y - 0.5 * CONSOLE_HEIGHT));
            let seen = head.orientation.inverse() * (console - head.position);
            assert!(seen.x.abs() < 1e-5 && seen.y < -0.25 && seen.z < -0.9, "{seen}");
            let normal = quad.pose.orientation * Vec3::Z;
            assert!(normal.dot((head.position - console).normalize()) > 0.999);
            assert!((quad.pose.orientation * Vec3::X).y.abs() < 1e-6);
        }
        let console = |height| PanelQuad::before(&head(height, 0.0)).stage_point(pos2(410.0, 544.0));
        assert!((console(1.7).distance(head(1.7, 0.0).position) - 1.18).abs() < 0.01);
        assert!(console(0.8).y > 0.3, "not in the floor");
    }

    #[test]
    fn a_ray_hits_what_it_points_at() {
        let quad = PanelQuad::before(&head(1.6, 0.7));
        let hand = Vec3::new(0.8, 1.0, 1.9);
        for at in [pos2(0.0, 0.0), pos2(820.0, 720.0), pos2(100.0, 600.0), pos2(-300.0, 900.0)] {
            let target = quad.stage_point(at);
            let hit = quad.hit(&ray(hand, target)).unwrap();
            assert!(hit.at.distance(at) < 0.1, "{hit:?}, expected {at}");
            assert!((hit.distance_m - hand.distance(target)).abs() < 1e-4);
        }
    }

    #[test]
    fn a_ray_that_misses_or_comes_from_behind_hits_nothing() {
        let quad = PanelQuad::before(&head(1.6, 0.0));
        let center = quad.stage_point(pos2(410.0, 360.0));
        let normal = quad.pose.orientation * Vec3::Z;
        assert_eq!(quad.hit(&ray(center + normal, center + normal * 2.0)), None);
        assert_eq!(quad.hit(&ray(center - normal, center)), None);
        assert_eq!(quad.hit(&ray(center + normal, center + normal + quad.pose.orientation * Vec3::X)), None);
    }
}
