//! [`Camera`]: a pinhole camera in OpenCV axes, as in camera files.

/// A pinhole camera in OpenCV axes: x right, y down, z forward; pixel centres at +0.5. With feature
/// `serde` it (de)serialises as a camera file: `{"width", "height", "K", "world_to_camera"}`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Intrinsic matrix `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`, row-major, in pixels.
    #[cfg_attr(feature = "serde", serde(rename = "K"))]
    pub k: [[f64; 3]; 3],
    /// Rigid transform from world to camera axes, 4x4, row-major, in world units.
    #[cfg_attr(feature = "serde", serde(rename = "world_to_camera"))]
    pub camera_from_world: [[f64; 4]; 4],
}

impl Camera {
    /// Returns a camera at `position` that looks at `target`, with square pixels, a vertical field
    /// of view of `fov_y` radians and an image of `width` by `height` pixels. `up` points up in the
    /// image.
    ///
    /// If `up` is parallel to the view direction, another axis replaces it; if `position` equals
    /// `target`, the view direction is +z.
    pub fn look_at(
        position: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        fov_y: f64,
        width: u32,
        height: u32,
    ) -> Camera {
        let forward = normalize(sub(target, position)).unwrap_or([0.0, 0.0, 1.0]);
        let right = normalize(cross(forward, up))
            .or_else(|| normalize(cross(forward, [0.0, 1.0, 0.0])))
            .or_else(|| normalize(cross(forward, [1.0, 0.0, 0.0])))
            .unwrap_or([1.0, 0.0, 0.0]);
        let down = cross(forward, right);
        let row = |axis: [f64; 3]| [axis[0], axis[1], axis[2], -dot(axis, position)];
        let focal = 0.5 * f64::from(height) / libm::tan(0.5 * fov_y);
        Camera {
            width,
            height,
            k: [[focal, 0.0, 0.5 * f64::from(width)], [0.0, focal, 0.5 * f64::from(height)], [0.0, 0.0, 1.0]],
            camera_from_world: [row(right), row(down), row(forward), [0.0, 0.0, 0.0, 1.0]],
        }
    }

    /// Returns the same view at another image size: the vertical field of view and the aspect ratio
    /// of a pixel stay.
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let scale = f64::from(height) / f64::from(self.height);
        let mut k = self.k;
        k[0][0] *= scale;
        k[1][1] *= scale;
        k[1][2] *= scale;
        // The principal point keeps its offset from the centre of the image.
        k[0][2] = 0.5 * f64::from(width) + (self.k[0][2] - 0.5 * f64::from(self.width)) * scale;
        Camera { width, height, k, camera_from_world: self.camera_from_world }
    }

    /// Mean distance between the eyes of an adult, in metres.
    pub const EYE_DISTANCE_M: f64 = 0.063;

    /// Returns the cameras of a left and a right eye, `distance` world units apart, with this camera
    /// midway between them and the same orientation.
    pub fn stereo_pair(&self, distance: f64) -> [Camera; 2] {
        // The left eye is at x = -distance / 2: points in its axes move by +distance / 2.
        [0.5, -0.5].map(|side| {
            let mut eye = self.clone();
            eye.camera_from_world[0][3] += side * distance;
            eye
        })
    }

    /// Position of the camera in world units.
    pub fn position(&self) -> [f64; 3] {
        let m = &self.camera_from_world;
        std::array::from_fn(|axis| -(0..3).map(|row| m[row][axis] * m[row][3]).sum::<f64>())
    }

    /// Checks that the camera can be rendered from: non-empty image, finite numbers, positive
    /// focal lengths, no skew, a rotation in `camera_from_world`.
    ///
    /// # Errors
    /// One sentence that names the first invalid number.
    pub fn check(&self) -> Result<(), String> {
        if self.width == 0 || self.height == 0 {
            return Err(format!("image size {}x{} is empty", self.width, self.height));
        }
        if !self.k.iter().flatten().chain(self.camera_from_world.iter().flatten()).all(|x| x.is_finite()) {
            return Err("a number in K or world_to_camera is not finite".into());
        }
        if self.k[0][0] <= 0.0 || self.k[1][1] <= 0.0 {
            return Err("focal lengths K[0][0] and K[1][1] must be positive".into());
        }
        if self.k[0][1] != 0.0 || self.k[1][0] != 0.0 || self.k[2] != [0.0, 0.0, 1.0] {
            return Err("K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]".into());
        }
        let row = |r: usize| [0, 1, 2].map(|c| self.camera_from_world[r][c]);
        let (x, y, z) = (row(0), row(1), row(2));
        let orthonormal =
            [dot(x, x) - 1.0, dot(y, y) - 1.0, dot(z, z) - 1.0, dot(x, y), dot(y, z), dot(z, x)];
        if orthonormal.iter().any(|e| e.abs() > 1e-3) || dot(cross(x, y), z) < 0.0 {
            return Err("the upper left 3x3 of world_to_camera must be a rotation".into());
        }
        if self.camera_from_world[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err("the last row of world_to_camera must be 0 0 0 1".into());
        }
        Ok(())
    }
}

pub(crate) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

pub(crate) fn normalize(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = norm(v);
    (length > 1e-9).then(|| v.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Projection of a world point to a pixel, and its depth.
    fn project(camera: &Camera, point: [f64; 3]) -> [f64; 3] {
        let m = &camera.camera_from_world;
        let [x, y, z] = [0, 1, 2].map(|r| dot([m[r][0], m[r][1], m[r][2]], point) + m[r][3]);
        let k = &camera.k;
        [k[0][0] * x / z + k[0][2], k[1][1] * y / z + k[1][2], z]
    }

    fn camera() -> Camera {
        Camera::look_at([1.0, 2.0, 3.0], [4.0, 2.0, -1.0], [0.0, 1.0, 0.0], 1.0, 640, 480)
    }

    #[test]
    fn a_stereo_pair_is_apart_and_has_parallax() {
        let camera = camera();
        let [left, right] = camera.stereo_pair(0.25);
        let [l, r] = [left.position(), right.position()];
        let center = [0, 1, 2].map(|axis| 0.5 * (l[axis] + r[axis]));
        assert!(norm(sub(center, camera.position())) < 1e-12);
        assert!((norm(sub(l, r)) - 0.25).abs() < 1e-12);
        // Disparity is focal length times distance over depth.
        let [x_left, _, depth] = project(&left, [4.0, 2.0, -1.0]);
        let [x_right, _, _] = project(&right, [4.0, 2.0, -1.0]);
        assert!(
            (x_left - x_right - camera.k[0][0] * 0.25 / depth).abs() < 1e-9,
            "the left eye sees it right"
        );
    }

    #[test]
    fn look_at_centers_the_target_and_points_up() {
        let camera = camera();
        assert_eq!(camera.check(), Ok(()));
        let [x, y, depth] = project(&camera, [4.0, 2.0, -1.0]);
        assert!((x - 320.0).abs() < 1e-9 && (y - 240.0).abs() < 1e-9 && (depth - 5.0).abs() < 1e-9);
        let above = project(&camera, [4.0, 2.5, -1.0]);
        assert!(above[1] < 240.0 && (above[0] - 320.0).abs() < 1e-9, "{above:?}");
        // Half the field of view above the axis is the upper edge.
        let edge = project(&camera, [4.0, 2.0 + 5.0 * 0.5f64.tan(), -1.0]);
        assert!(edge[1].abs() < 1e-9, "{edge:?}");
        let position = camera.position();
        assert!(position.iter().zip([1.0, 2.0, 3.0]).all(|(a, e)| (a - e).abs() < 1e-12), "{position:?}");
    }

    #[test]
    fn look_at_survives_degenerate_directions() {
        for (target, up) in [
            ([0.0, 5.0, 0.0], [0.0, 1.0, 0.0]),
            ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
            ([3.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0, 0.0, 1.0], [0.0, 0.0, 0.0]),
        ] {
            let camera = Camera::look_at([0.0; 3], target, up, 1.0, 64, 64);
            assert_eq!(camera.check(), Ok(()), "target {target:?}, up {up:?}");
        }
    }

    #[test]
    fn resizing_preserves_the_view() {
        let camera = camera();
        let resized = camera.resized(1280, 960);
        let point = [3.5, 2.3, -0.5];
        let (small, large) = (project(&camera, point), project(&resized, point));
        assert!((large[0] - 2.0 * small[0]).abs() < 1e-9 && (large[1] - 2.0 * small[1]).abs() < 1e-9);
        // A wider image extends the view at both sides.
        let wide = project(&camera.resized(1000, 480), point);
        assert!((wide[0] - 500.0 - (small[0] - 320.0)).abs() < 1e-9 && (wide[1] - small[1]).abs() < 1e-9);
    }

    #[test]
    fn check_names_the_invalid_number() {
        let refused = |expected: &str, change: &dyn Fn(&mut Camera)| {
            let mut camera = camera();
            change(&mut camera);
            let message = camera.check().expect_err(expected);
            assert!(message.contains(expected), "'{expected}' expected: {message}");
        };
        refused("image size 0x480", &|c| c.width = 0);
        refused("not finite", &|c| c.k[0][2] = f64::NAN);
        refused("focal lengths", &|c| c.k[1][1] = -1.0);
        refused("K must be", &|c| c.k[0][1] = 0.1);
        refused("must be a rotation", &|c| c.camera_from_world[0][0] *= 2.0);
        refused("must be a rotation", &|c| c.camera_from_world[0] = c.camera_from_world[0].map(|x| -x));
        refused("last row", &|c| c.camera_from_world[3][3] = 2.0);
    }
}
