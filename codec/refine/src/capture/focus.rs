//! [`Focus`]: what the cameras of a rig look at, how far away it is, and how near is too near.

use codec::{Camera, NEAR_SHARE};
use glam::{DMat3, DVec3};

use crate::median::median;

/// Cameras without a common point are taken to look at one so many times as far away as they are apart.
const FAR_FROM_RIG: f64 = 3.0;

/// Axes that cross farther away than so many radii of the rig are parallel but for the errors of their calibration.
const CROSSING_MAX: f64 = 30.0;

/// Largest near distance in distances of the nearest camera: one that is much nearer to its subject than the others still
/// sees it.
const NEAREST_SHARE: f64 = 0.4;

/// Least near distance in distances of the cameras. A camera in the middle of the others would make the near distance 0 for
/// all of them, and haze would come back: pictures of panoptic-basketball from held cameras then lose 16 dB, 1 dB with it.
const NEAR_SHARE_MIN: f64 = 0.05;

/// The point that cameras look at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// The point, in units of the capture.
    pub center: DVec3,
    /// Median distance of the cameras from it, above 0.
    pub distance: f64,
    /// Distance of the nearest camera from it.
    pub nearest: f64,
}

impl Focus {
    /// The focus of `cameras`: the point nearest to their optical axes, or, where these are nearly parallel or have it behind
    /// them, a point before the rig at three times its radius. `None` if all cameras are at one place.
    pub fn from_cameras<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Option<Focus> {
        let axes: Vec<Axis> = cameras.into_iter().map(Axis::new).collect();
        Focus::from_axes(&axes)
    }

    pub(crate) fn from_axes(axes: &[Axis]) -> Option<Focus> {
        let count = axes.len().max(1) as f64;
        let middle = axes.iter().map(|axis| axis.position).sum::<DVec3>() / count;
        let distances = |from: DVec3| axes.iter().map(move |axis| axis.position.distance(from));
        let to = |from: DVec3| median(distances(from).collect());
        let radius = to(middle)?;
        let is_near = |point: &DVec3| to(*point).is_some_and(|far| far <= CROSSING_MAX * radius);
        let crossing = nearest_to_axes(axes).filter(|point| is_ahead(*point, axes)).filter(is_near);
        let center = crossing.unwrap_or_else(|| {
            let forward = axes.iter().map(|axis| axis.forward).sum::<DVec3>() / count;
            middle + FAR_FROM_RIG * radius * forward
        });
        let distance = to(center).filter(|distance| *distance > 0.0)?;
        let nearest = distances(center).fold(f64::INFINITY, f64::min);
        (center.is_finite() && distance.is_finite()).then_some(Focus { center, distance, nearest })
    }

    /// [`Field::near`](codec::Field::near) of what these cameras photograph.
    pub fn near(&self) -> f64 {
        let of_nearest = (NEAREST_SHARE * self.nearest).max(NEAR_SHARE_MIN * self.distance);
        (NEAR_SHARE * self.distance).min(of_nearest)
    }
}

/// The point nearest to the optical axes of `cameras`, by least squares; `None` where these are nearly parallel, or the point
/// is behind one of them.
pub fn common_point<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Option<DVec3> {
    let axes: Vec<Axis> = cameras.into_iter().map(Axis::new).collect();
    nearest_to_axes(&axes).filter(|point| point.is_finite() && is_ahead(*point, &axes))
}

fn is_ahead(point: DVec3, axes: &[Axis]) -> bool {
    axes.iter().all(|axis| (point - axis.position).dot(axis.forward) > 0.0)
}

/// The optical axis of a camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    /// Position of the camera.
    pub(crate) position: DVec3,
    /// Unit vector.
    pub(crate) forward: DVec3,
}

impl Axis {
    fn new(camera: &Camera) -> Axis {
        Axis {
            position: DVec3::from_array(camera.position()),
            forward: DVec3::from_slice(&camera.camera_from_world[2]),
        }
    }
}

/// The point nearest to all optical axes, by least squares; `None` for parallel axes or a single
/// camera.
pub(crate) fn nearest_to_axes(axes: &[Axis]) -> Option<DVec3> {
    let (mut matrix, mut side) = (DMat3::ZERO, DVec3::ZERO);
    for Axis { position, forward } in axes {
        let f = *forward;
        let across = DMat3::IDENTITY - DMat3::from_cols(f * f.x, f * f.y, f * f.z);
        matrix += across;
        side += across * *position;
    }
    // Two axes at a small angle a have a determinant of about a^2 / 4.
    let matrix_of_one = matrix * (1.0 / axes.len().max(1) as f64);
    (matrix_of_one.determinant() > 1e-5).then(|| matrix.inverse() * side)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(position: [f64; 3], target: [f64; 3]) -> Camera {
        Camera::look_at(position, target, [0.0, 1.0, 0.0], 0.9, 64, 48)
    }

    fn ring(radius: f64, offset: f64) -> Vec<Camera> {
        let camera = |i: usize| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / 8.0).sin_cos();
            at([offset + radius * sin, offset, offset + radius * cos], [offset; 3])
        };
        (0..8).map(camera).collect()
    }

    #[test]
    fn a_ring_looks_at_its_centre_in_any_unit_and_anywhere() {
        for unit in [1e-3, 1.0, 1e6] {
            let focus = Focus::from_cameras(&ring(3.0 * unit, 7.0 * unit)).unwrap();
            assert!((focus.distance / unit - 3.0).abs() < 1e-6, "{focus:?}");
            assert!((focus.near() / unit - 3.0 * NEAR_SHARE).abs() < 1e-6, "{focus:?}");
        }
    }

    #[test]
    fn a_camera_close_to_its_subject_brings_the_near_distance_with_it() {
        let mut cameras = ring(3.0, 0.0);
        cameras.push(at([0.5, 0.0, 0.0], [0.0; 3]));
        assert!((Focus::from_cameras(&cameras).unwrap().near() - 0.2).abs() < 1e-6);
    }

    #[test]
    fn a_camera_where_the_others_look_leaves_them_a_near_distance() {
        let mut cameras = ring(3.0, 0.0);
        cameras.push(at([0.001, 0.0, 0.0], [0.0; 3]));
        assert!((Focus::from_cameras(&cameras).unwrap().near() - 0.15).abs() < 1e-6);
    }

    #[test]
    fn axes_that_hardly_cross_are_parallel() {
        // Cameras a unit apart, turned to each other by a third of a degree: what they look at may be three units away.
        let toe_in = |far: f64| [at([-0.5, 0.0, 0.0], [0.0, 0.0, far]), at([0.5, 0.0, 0.0], [0.0, 0.0, far])];
        assert!(Focus::from_cameras(&toe_in(140.0)).unwrap().distance < 3.0);
        assert!((Focus::from_cameras(&toe_in(10.0)).unwrap().distance - 10.0).abs() < 0.1);
    }

    #[test]
    fn parallel_cameras_look_ahead_and_one_camera_nowhere() {
        let parallel = [at([0.0; 3], [0.0, 0.0, 1.0]), at([1.0, 0.0, 0.0], [1.0, 0.0, 1.0])];
        let focus = Focus::from_cameras(&parallel).unwrap();
        assert!(focus.center.distance(DVec3::new(0.5, 0.0, 1.5)) < 1e-9, "{focus:?}");
        assert!(Focus::from_cameras(&parallel[..1]).is_none() && Focus::from_cameras(&[]).is_none());
    }

    #[test]
    fn cameras_that_look_outwards_have_a_near_distance() {
        let outwards: Vec<Camera> = ring(2.0, 0.0)
            .iter()
            .map(|camera| at(camera.position(), camera.position().map(|x| 2.0 * x)))
            .collect();
        let focus = Focus::from_cameras(&outwards).unwrap();
        assert!(focus.near() > 0.0 && focus.near() <= NEAR_SHARE * 2.0 + 1e-9, "{focus:?}");
    }
}
