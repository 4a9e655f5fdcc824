//! [`Pinhole`]: a camera as projection matrices.

use codec::Camera;
use glam::{DMat3, DVec3};

use crate::capture::{Axis, nearest_to_axes};
use crate::median::median;

/// A camera as projection matrices. Image coordinates start at the corner of the image: the centre of
/// the first pixel is at 0.5.
#[derive(Clone, Debug)]
pub(super) struct Pinhole {
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
    /// Position in the world.
    pub(super) position: DVec3,
    /// Unit vector along the optical axis.
    pub(super) forward: DVec3,
    /// Unit vector towards the top of the image.
    pub(super) up: DVec3,
    /// Geometric mean of the two focal lengths, in pixels.
    pub(super) focal: f64,
    /// Larger of the two focal lengths, in pixels.
    pub(super) focal_max: f64,
    /// `pixel_from_world * point + offset` is `(u depth, v depth, depth)`.
    pub(super) pixel_from_world: DMat3,
    pub(super) offset: DVec3,
    /// Takes `(u, v, 1)` to the step of the pixel's ray per unit of depth.
    pub(super) world_from_pixel: DMat3,
}

impl Pinhole {
    pub(super) fn new(camera: &Camera) -> Pinhole {
        let m = &camera.camera_from_world;
        let [right, down, forward] = [0, 1, 2].map(|r| DVec3::new(m[r][0], m[r][1], m[r][2]));
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        let translation = DVec3::new(m[0][3], m[1][3], m[2][3]);
        let k = &camera.k;
        let intrinsics = DMat3::from_cols_array_2d(k).transpose();
        // K has no skew, so its inverse has this form.
        let back = DMat3::from_cols(
            DVec3::new(1.0 / k[0][0], 0.0, 0.0),
            DVec3::new(0.0, 1.0 / k[1][1], 0.0),
            DVec3::new(-k[0][2] / k[0][0], -k[1][2] / k[1][1], 1.0),
        );
        Pinhole {
            size: [camera.width, camera.height],
            position: DVec3::from_array(camera.position()),
            forward,
            up: -down,
            focal: (k[0][0] * k[1][1]).sqrt(),
            focal_max: k[0][0].max(k[1][1]),
            pixel_from_world: intrinsics * rotation,
            offset: intrinsics * translation,
            world_from_pixel: rotation.transpose() * back,
        }
    }

    /// Its optical axis.
    pub(super) fn axis(&self) -> Axis {
        Axis { position: self.position, forward: self.forward }
    }

    /// The same view with pixels `factor` times as large. The remainder at the right and bottom is
    /// cut off.
    pub(super) fn shrunk(&self, factor: u32) -> Pinhole {
        let f = f64::from(factor);
        let smaller = DMat3::from_diagonal(DVec3::new(1.0 / f, 1.0 / f, 1.0));
        let larger = DMat3::from_diagonal(DVec3::new(f, f, 1.0));
        Pinhole {
            size: self.size.map(|n| n / factor),
            focal: self.focal / f,
            focal_max: self.focal_max / f,
            pixel_from_world: smaller * self.pixel_from_world,
            offset: smaller * self.offset,
            world_from_pixel: self.world_from_pixel * larger,
            ..self.clone()
        }
    }

    /// Image coordinates and depth of a point, `None` if it is not in front of the camera. The
    /// coordinates may lie outside the image.
    pub(super) fn project(&self, point: DVec3) -> Option<([f64; 2], f64)> {
        let q = self.pixel_from_world * point + self.offset;
        (q.z > 0.0).then(|| ([q.x / q.z, q.y / q.z], q.z))
    }

    /// Index of the pixel at image coordinates; `None` outside the image.
    pub(super) fn pixel(&self, [u, v]: [f64; 2]) -> Option<usize> {
        let [width, height] = self.size.map(f64::from);
        let within = u >= 0.0 && v >= 0.0 && u < width && v < height;
        within.then(|| v as usize * self.size[0] as usize + u as usize)
    }

    /// Step of the ray through the centre of a pixel per unit of depth.
    pub(super) fn ray(&self, [x, y]: [u32; 2]) -> DVec3 {
        self.world_from_pixel * DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0)
    }
}

/// The point nearest to the optical axes of `cameras`; `None` for parallel axes or a single camera.
pub(super) fn common_point(cameras: &[Pinhole]) -> Option<DVec3> {
    nearest_to_axes(&cameras.iter().map(Pinhole::axis).collect::<Vec<_>>())
}

/// Radius of the rig: median distance of the cameras from their [`common_point`].
pub(super) fn rig_radius(cameras: &[Pinhole]) -> Option<f64> {
    let center = common_point(cameras)?;
    median(cameras.iter().map(|pinhole| pinhole.position.distance(center)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::test_scene::ring;

    #[test]
    fn rays_project_to_their_pixels() {
        for factor in [1, 4] {
            let camera = Camera::look_at([1.0, 2.0, 3.0], [0.0, 0.5, 0.0], [0.0, 1.0, 0.0], 0.9, 64, 48);
            let pinhole = Pinhole::new(&camera).shrunk(factor);
            let point = pinhole.position + 2.5 * pinhole.ray([5, 7]);
            let ([u, v], depth) = pinhole.project(point).unwrap();
            assert!((u - 5.5).abs() < 1e-9 && (v - 7.5).abs() < 1e-9 && (depth - 2.5).abs() < 1e-9);
            assert!((depth - (point - pinhole.position).dot(pinhole.forward)).abs() < 1e-9);
            assert!(pinhole.project(pinhole.position - pinhole.forward).is_none());
        }
    }

    #[test]
    fn a_rig_has_a_center_and_a_radius() {
        let cameras: Vec<Pinhole> = ring(8, 3.0, 16).iter().map(Pinhole::new).collect();
        assert!(common_point(&cameras).unwrap().length() < 1e-9);
        assert!((rig_radius(&cameras).unwrap() - 3.0).abs() < 1e-9);
        assert_eq!(rig_radius(&cameras[..1]), None);
        assert_eq!(rig_radius(&[]), None);
    }
}
