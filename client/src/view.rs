//! [`View`]: the pinhole camera of one eye, as the renderer takes it.

use codec::Camera;
use glam::{DMat4, DVec3, UVec2, Vec2, vec2};

/// A pinhole camera and its image size, in OpenCV axes: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Rigid transform from the clip's world, in its units. In f64, because a clip may lie far from the
    /// origin of its world.
    pub view_from_world: DMat4,
    /// Focal lengths in pixels, positive.
    pub focal: Vec2,
    /// Principal point in pixels from the image's top left corner.
    pub principal: Vec2,
    /// Size of the image in pixels, not empty.
    pub size: UVec2,
}

impl View {
    /// The view of `camera`, which has passed [`Camera::check`].
    pub fn from_camera(camera: &Camera) -> View {
        let k = camera.k.map(|row| row.map(|x| x as f32));
        View {
            view_from_world: DMat4::from_cols_array_2d(&camera.camera_from_world).transpose(),
            focal: vec2(k[0][0], k[1][1]),
            principal: vec2(k[0][2], k[1][2]),
            size: UVec2::new(camera.width, camera.height),
        }
    }

    /// Position of the eye in the world.
    pub fn eye(&self) -> DVec3 {
        let m = self.view_from_world;
        let translation = m.w_axis.truncate();
        -DVec3::new(
            m.x_axis.truncate().dot(translation),
            m.y_axis.truncate().dot(translation),
            m.z_axis.truncate().dot(translation),
        )
    }

    /// Viewing direction in the world, a unit vector.
    pub fn forward(&self) -> DVec3 {
        self.view_from_world.row(2).truncate()
    }
}

/// Mean position and direction of several eyes, by which one sort serves all of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CyclopeanEye {
    pub(crate) position: DVec3,
    pub(crate) forward: DVec3,
}

impl CyclopeanEye {
    pub(crate) fn new(views: &[View]) -> CyclopeanEye {
        let count = views.len().max(1) as f64;
        let position = views.iter().map(View::eye).sum::<DVec3>() / count;
        let forward = views.iter().map(View::forward).sum::<DVec3>();
        CyclopeanEye { position, forward: forward.normalize_or_zero() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at([1.0, 2.0, -3.0], [0.5, 0.0, 4.0], [0.1, 1.0, 0.0], 1.0, 320, 200)
    }

    /// Pixel of the point `world` in the image of `view`.
    fn project(view: &View, world: DVec3) -> Vec2 {
        let p = view.view_from_world.transform_point3(world).as_vec3();
        view.focal * p.truncate() / p.z + view.principal
    }

    #[test]
    fn eye_and_forward_match_the_camera() {
        let view = View::from_camera(&camera());
        assert!(view.eye().distance(DVec3::new(1.0, 2.0, -3.0)) < 1e-12);
        let expected = (DVec3::new(0.5, 0.0, 4.0) - DVec3::new(1.0, 2.0, -3.0)).normalize();
        assert!(view.forward().distance(expected) < 1e-12);
    }

    #[test]
    fn the_target_is_at_the_principal_point_and_up_is_up() {
        let view = View::from_camera(&camera());
        assert!(project(&view, DVec3::new(0.5, 0.0, 4.0)).distance(vec2(160.0, 100.0)) < 1e-3);
        assert!(project(&view, DVec3::new(0.5, 1.0, 4.0)).y < 99.0);
    }

    #[test]
    fn the_cyclopean_eye_is_midway_between_two_eyes() {
        let view = View::from_camera(&camera());
        let eyes = camera().stereo_pair(0.25).map(|eye| View::from_camera(&eye));
        let center = CyclopeanEye::new(&eyes);
        assert!(center.position.distance(view.eye()) < 1e-12);
        assert!(center.forward.distance(view.forward()) < 1e-12);
    }
}
