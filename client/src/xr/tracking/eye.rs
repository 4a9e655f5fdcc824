//! [`View`]s from the poses and angles that a runtime reports.

use codec::Camera;
use glam::{Quat, UVec2};
use openxr as xr;

use crate::headset::interaction::{Pose, Similarity};
use crate::view::{Fov, View};

impl From<xr::Fovf> for Fov {
    fn from(fov: xr::Fovf) -> Fov {
        Fov { left: fov.angle_left, right: fov.angle_right, up: fov.angle_up, down: fov.angle_down }
    }
}

/// Converts a pose of the runtime.
pub(in crate::xr) fn pose(pose: xr::Posef) -> Pose {
    let (p, q) = (pose.position, pose.orientation);
    Pose { position: [p.x, p.y, p.z].into(), orientation: Quat::from_xyzw(q.x, q.y, q.z, q.w) }
}

/// The view of a clip from the pose `eye` in the stage, in an image of `size` pixels with its edges at the
/// angles of `fov`. `None` for an invalid pose or angles without an image: the view axis may lie outside the
/// image, but left must be left of right.
pub(in crate::xr) fn view(eye: &Pose, fov: Fov, size: UVec2, stage_from_clip: &Similarity) -> Option<View> {
    if !eye.is_valid() {
        return None;
    }
    View::from_angles(stage_from_clip.view_from_clip(eye), fov, size)
}

/// The pose midway between the eyes.
pub(in crate::xr) fn head(eyes: &[Pose; 2]) -> Pose {
    Pose {
        position: 0.5 * (eyes[0].position + eyes[1].position),
        orientation: eyes[0].orientation.slerp(eyes[1].orientation, 0.5).normalize(),
    }
}

/// The camera file of a view.
pub(in crate::xr) fn camera(view: &View) -> Camera {
    let [fx, fy, cx, cy] = [view.focal.x, view.focal.y, view.principal.x, view.principal.y].map(f64::from);
    Camera {
        width: view.size.x,
        height: view.size.y,
        k: [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        camera_from_world: view.view_from_world.transpose().to_cols_array_2d(),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3, Vec2, Vec3, vec2, vec3};

    use super::*;

    const SIZE: UVec2 = UVec2::new(320, 240);
    /// Wider outwards than inwards, like the left eye of a headset.
    const FOV: Fov = Fov { left: -0.9, right: 0.7, up: 0.6, down: -0.8 };
    const SAME: Similarity = Similarity { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    fn at(position: Vec3) -> Pose {
        Pose { position, ..Pose::IDENTITY }
    }

    /// The pixel of a point of the stage in the image of `view`, which must be one of [`SAME`].
    fn project(view: &View, point: Vec3) -> Vec2 {
        let p = view.view_from_world.transform_point3(point.as_dvec3()).as_vec3();
        assert!(p.z > 0.0, "{p}");
        view.focal * p.truncate() / p.z + view.principal
    }

    #[test]
    fn the_edges_of_the_image_are_at_the_four_angles() {
        let eye = at(vec3(0.3, 1.6, 0.2));
        let view = view(&eye, FOV, SIZE, &SAME).unwrap();
        for (horizontal, vertical, corner) in [
            (FOV.left, FOV.up, vec2(0.0, 0.0)),
            (FOV.right, FOV.up, vec2(320.0, 0.0)),
            (FOV.left, FOV.down, vec2(0.0, 240.0)),
            (FOV.right, FOV.down, vec2(320.0, 240.0)),
        ] {
            // Two metres ahead, which is -z in the stage.
            let point = eye.position + 2.0 * vec3(horizontal.tan(), vertical.tan(), -1.0);
            assert!(project(&view, point).distance(corner) < 1e-3, "{corner}");
        }
    }

    #[test]
    fn turning_the_head_moves_the_picture_the_other_way() {
        let point = vec3(0.0, 1.6, -2.0);
        let turned = |orientation| {
            let eye = Pose { orientation, ..at(vec3(0.0, 1.6, 0.0)) };
            project(&view(&eye, FOV, SIZE, &SAME).unwrap(), point)
        };
        let straight = turned(Quat::IDENTITY);
        assert!(turned(Quat::from_rotation_y(0.2)).x > straight.x, "to the left");
        assert!(turned(Quat::from_rotation_x(0.2)).y > straight.y, "upwards");
        assert!(turned(Quat::from_rotation_z(0.2)).distance(straight) < 1e-3, "on the axis nothing rolls");
    }

    #[test]
    fn eyes_apart_see_the_disparity_of_the_depth() {
        let eyes = [-0.032, 0.032].map(|x| at(vec3(x, 1.6, 0.0)));
        let views = eyes.map(|eye| view(&eye, FOV, SIZE, &SAME).unwrap());
        let point = vec3(0.1, 1.5, -1.5);
        let disparity = project(&views[0], point) - project(&views[1], point);
        assert!(disparity.distance(vec2(views[0].focal.x * 0.064 / 1.5, 0.0)) < 1e-3, "{disparity}");
        assert!(head(&eyes).position.distance(vec3(0.0, 1.6, 0.0)) < 1e-6);
    }

    #[test]
    fn a_clip_of_any_unit_looks_the_same_from_where_it_stands() {
        // In millimetres, z up, and moved.
        let stage_from_clip = Similarity {
            scale: 0.001,
            rotation: DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2),
            translation: DVec3::new(0.5, 0.0, -2.0),
        };
        let eye = at(vec3(0.0, 1.6, 0.0));
        let in_stage = view(&eye, FOV, SIZE, &SAME).unwrap();
        let in_clip = view(&eye, FOV, SIZE, &stage_from_clip).unwrap();
        let clip_point = DVec3::new(100.0, 200.0, 1700.0);
        let stage_point = stage_from_clip.point(clip_point).as_vec3();
        let (a, b) = (project(&in_clip, clip_point.as_vec3()), project(&in_stage, stage_point));
        assert!(a.distance(b) < 1e-2, "{a} {b}");
        let rotation = glam::DMat3::from_mat4(in_clip.view_from_world);
        assert!((rotation.determinant() - 1.0).abs() < 1e-5, "rigid");
    }

    #[test]
    fn angles_without_an_image_are_refused() {
        let eye = at(Vec3::Y);
        for fov in [
            Fov { left: 0.7, right: -0.9, ..FOV },
            Fov { up: -0.8, down: 0.6, ..FOV },
            Fov { left: 0.1, right: 0.1, ..FOV },
            Fov { right: f32::NAN, ..FOV },
            Fov { right: 1.6, ..FOV },
        ] {
            assert_eq!(view(&eye, fov, SIZE, &SAME), None, "{fov:?}");
        }
        assert_eq!(view(&at(Vec3::NAN), FOV, SIZE, &SAME), None);
        // The axis need not lie within the image.
        assert!(view(&eye, Fov { left: 0.1, ..FOV }, SIZE, &SAME).is_some());
    }

    #[test]
    fn a_camera_file_holds_the_same_view() {
        let eye = Pose { orientation: Quat::from_rotation_y(0.4), ..at(vec3(0.3, 1.6, 0.2)) };
        let view = view(&eye, FOV, SIZE, &SAME).unwrap();
        let camera = camera(&view);
        assert_eq!(camera.check(), Ok(()));
        assert_eq!(View::from_camera(&camera), view);
    }
}
