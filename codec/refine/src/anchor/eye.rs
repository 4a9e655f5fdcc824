//! [`Eye`]: a camera in the form in which points and rays pass through it, and what several of them
//! look at.

use codec::Camera;
use glam::{DMat3, DVec3};

/// A camera. Pixels are counted from the corner of the image, so that the first has its centre at
/// 0.5.
#[derive(Clone, Debug)]
pub(super) struct Eye {
    /// Width and height in pixels.
    pub(super) size: [u32; 2],
    /// Where the camera stands.
    pub(super) position: DVec3,
    /// Its optical axis.
    pub(super) forward: DVec3,
    /// Upwards in the image.
    pub(super) up: DVec3,
    /// Geometric mean of its focal lengths, in pixels.
    pub(super) focal: f64,
    /// The larger of them.
    pub(super) focal_max: f64,
    /// Takes a point of the world, with `offset` added, to its pixel times its depth, and its depth.
    pub(super) pixel_from_world: DMat3,
    pub(super) offset: DVec3,
    /// Takes a pixel and 1 to the way that its ray goes per unit of depth.
    pub(super) world_from_pixel: DMat3,
}

impl Eye {
    pub(super) fn new(camera: &Camera) -> Eye {
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
        Eye {
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

    /// The same view in pixels `factor` times as large; what is left over at the right and at the
    /// bottom is cut off.
    pub(super) fn shrunk(&self, factor: u32) -> Eye {
        let f = f64::from(factor);
        let smaller = DMat3::from_diagonal(DVec3::new(1.0 / f, 1.0 / f, 1.0));
        let larger = DMat3::from_diagonal(DVec3::new(f, f, 1.0));
        Eye {
            size: self.size.map(|n| n / factor),
            focal: self.focal / f,
            focal_max: self.focal_max / f,
            pixel_from_world: smaller * self.pixel_from_world,
            offset: smaller * self.offset,
            world_from_pixel: self.world_from_pixel * larger,
            ..self.clone()
        }
    }

    /// Where in the image a point lies, perhaps beyond its edges, and its depth; `None` unless it is
    /// in front of the camera.
    pub(super) fn project(&self, point: DVec3) -> Option<([f64; 2], f64)> {
        let q = self.pixel_from_world * point + self.offset;
        (q.z > 0.0).then(|| ([q.x / q.z, q.y / q.z], q.z))
    }

    /// Number of the pixel that a place in the image belongs to.
    pub(super) fn pixel(&self, [u, v]: [f64; 2]) -> Option<usize> {
        let [width, height] = self.size.map(f64::from);
        let within = u >= 0.0 && v >= 0.0 && u < width && v < height;
        within.then(|| v as usize * self.size[0] as usize + u as usize)
    }

    /// The way that the ray through the centre of a pixel goes per unit of depth.
    pub(super) fn ray(&self, [x, y]: [u32; 2]) -> DVec3 {
        self.world_from_pixel * DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0)
    }
}

/// The point that the optical axes pass nearest to, by least squares; `None` where they are parallel
/// (as that of a single camera is).
pub(super) fn nearest_to_axes(eyes: &[Eye]) -> Option<DVec3> {
    let (mut matrix, mut side) = (DMat3::ZERO, DVec3::ZERO);
    for eye in eyes {
        let f = eye.forward;
        let across = DMat3::IDENTITY - DMat3::from_cols(f * f.x, f * f.y, f * f.z);
        matrix += across;
        side += across * eye.position;
    }
    // Two axes at a small angle a have a determinant of about a^2 / 4.
    let matrix_of_one = matrix * (1.0 / eyes.len().max(1) as f64);
    (matrix_of_one.determinant() > 1e-5).then(|| matrix.inverse() * side)
}

/// Radius of the rig: median distance of the cameras from the point that their axes pass nearest to.
pub(super) fn rig_radius(eyes: &[Eye]) -> Option<f64> {
    let middle = nearest_to_axes(eyes)?;
    let mut distances: Vec<f64> = eyes.iter().map(|eye| eye.position.distance(middle)).collect();
    distances.sort_by(f64::total_cmp);
    let n = distances.len();
    Some(0.5 * (distances[(n - 1) / 2] + distances[n / 2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::scene::ring;

    #[test]
    fn a_ray_comes_back_to_its_pixel() {
        for factor in [1, 4] {
            let camera = Camera::look_at([1.0, 2.0, 3.0], [0.0, 0.5, 0.0], [0.0, 1.0, 0.0], 0.9, 64, 48);
            let eye = Eye::new(&camera).shrunk(factor);
            let point = eye.position + 2.5 * eye.ray([5, 7]);
            let ([u, v], depth) = eye.project(point).unwrap();
            assert!((u - 5.5).abs() < 1e-9 && (v - 7.5).abs() < 1e-9 && (depth - 2.5).abs() < 1e-9);
            assert!((depth - (point - eye.position).dot(eye.forward)).abs() < 1e-9);
            assert!(eye.project(eye.position - eye.forward).is_none());
        }
    }

    #[test]
    fn a_rig_has_a_middle_and_a_radius() {
        let eyes: Vec<Eye> = ring(8, 3.0, 16).iter().map(Eye::new).collect();
        assert!(nearest_to_axes(&eyes).unwrap().length() < 1e-9);
        assert!((rig_radius(&eyes).unwrap() - 3.0).abs() < 1e-9);
        assert_eq!(rig_radius(&eyes[..1]), None);
        assert_eq!(rig_radius(&[]), None);
    }
}
