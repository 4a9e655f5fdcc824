//! [`View`]: the pinhole camera of one eye, as the renderer takes it, and [`Fov`], the angles of its image.

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
    /// x/z and y/z at the upper left and at the lower right corner of the image, or of the larger one that this one is a
    /// part of: parts must show the same Gaussians.
    pub slopes: [Vec2; 2],
}

/// Four angles from the view axis to the edges of an image, in radians, right and up positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fov {
    /// To the left edge; negative if the axis is right of it.
    pub left: f32,
    /// To the right edge.
    pub right: f32,
    /// To the upper edge.
    pub up: f32,
    /// To the lower edge; negative if the axis is above it.
    pub down: f32,
}

impl View {
    /// The view whose image of `size` pixels has its edges at the angles of `fov`. `None` for angles without an
    /// image: the view axis may lie outside the image, but left must be left of right.
    pub fn from_angles(view_from_world: DMat4, fov: Fov, size: UVec2) -> Option<View> {
        let angles = [fov.left, fov.right, fov.up, fov.down];
        let [left, right, up, down] = angles.map(f32::tan);
        let focal = size.as_vec2() / vec2(right - left, up - down);
        let principal = vec2(-left, up) * focal;
        let is_ahead = angles.iter().all(|angle| angle.abs() < std::f32::consts::FRAC_PI_2);
        let has_image = is_ahead && focal.is_finite() && focal.min_element() > 0.0;
        has_image.then(|| View::new(view_from_world, focal, principal, size))
    }

    /// A view with an image of its own.
    pub fn new(view_from_world: DMat4, focal: Vec2, principal: Vec2, size: UVec2) -> View {
        let slopes = [-principal / focal, (size.as_vec2() - principal) / focal];
        View { view_from_world, focal, principal, size, slopes }
    }

    /// The view of `camera`, which has passed [`Camera::check`].
    pub fn from_camera(camera: &Camera) -> View {
        let k = camera.k.map(|row| row.map(|x| x as f32));
        View::new(
            DMat4::from_cols_array_2d(&camera.camera_from_world).transpose(),
            vec2(k[0][0], k[1][1]),
            vec2(k[0][2], k[1][2]),
            UVec2::new(camera.width, camera.height),
        )
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
