//! [`free_views`]: pictures from new viewpoints (the paper's appendix "The Transmitted Package
//! from Free Viewpoints").

use codec::Camera;
use glam::{DMat3, DQuat, DVec3};
use refine::image::Image;
use refine::reference::{self, Order};

use super::sheet::sheet;
use crate::capture::CaptureFiles;
use crate::input::Input;

/// Elevation of two of the views above and below the cameras, and the highest absolute elevation, in
/// degrees.
const RAISED: f64 = 30.0;
const POLE: f64 = 80.0;

/// Distance of the near view relative to the cameras'.
const NEAR: f64 = 0.6;

/// Renders `input` at clip time `t` from four views, side by side: halfway between two neighbouring
/// fitted cameras, above that, below it, and near. `None` if the cameras look at no common point.
pub fn free_views(input: &Input, capture_files: &CaptureFiles, t: f64) -> Option<Image> {
    let cameras: Vec<&Camera> = capture_files
        .capture
        .cameras
        .iter()
        .filter(|camera| !camera.held)
        .map(|camera| &camera.camera)
        .collect();
    let draw = |camera: &Camera| reference::render(&input.to_reference(), camera, t, Order::Depth);
    Some(sheet(&[views(&cameras)?.iter().map(draw).collect()]))
}

/// The cameras of [`free_views`].
fn views(cameras: &[&Camera]) -> Option<[Camera; 4]> {
    let target = common_point(cameras)?;
    let up: DVec3 = cameras.iter().map(|camera| -axis(camera, 1)).sum();
    let up = up.try_normalize()?;
    let offset = |camera: &Camera| DVec3::from(camera.position()) - target;
    let first = offset(cameras[0]);
    // The nearest camera in another direction.
    let others =
        cameras.iter().map(|camera| offset(camera)).filter(|other| first.angle_between(*other) > 1e-3);
    let next = others.min_by(|a, b| first.angle_between(*a).total_cmp(&first.angle_between(*b)))?;
    let between =
        (first.normalize() + next.normalize()).try_normalize()? * 0.5 * (first.length() + next.length());
    let east = between.cross(up).try_normalize()?;
    let height = 90.0 - between.angle_between(up).to_degrees();
    let raised = |degrees: f64| {
        let to = (height + degrees).clamp(-POLE, POLE);
        DQuat::from_axis_angle(east, (to - height).to_radians()) * between
    };
    let view = |offset: DVec3| {
        let Camera { k, width, height, .. } = cameras[0];
        let position = (target + offset).to_array();
        let looking = Camera::look_at(position, target.to_array(), up.to_array(), 1.0, *width, *height);
        Camera { k: *k, ..looking }
    };
    Some([between, raised(RAISED), raised(-RAISED), NEAR * between].map(view))
}

/// An axis of a camera in the world: x right, y down, z forward.
fn axis(camera: &Camera, row: usize) -> DVec3 {
    let [x, y, z, _] = camera.camera_from_world[row];
    DVec3::new(x, y, z)
}

/// The point nearest to the lines of sight of all cameras, by least squares; `None` where they are
/// nearly parallel, or it lies behind the first.
fn common_point(cameras: &[&Camera]) -> Option<DVec3> {
    let (mut across, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let forward = axis(camera, 2);
        // Projects onto the plane across the line of sight.
        let outer = DMat3::from_cols(forward * forward.x, forward * forward.y, forward * forward.z);
        let part = DMat3::IDENTITY - outer;
        across += part;
        sum += part * DVec3::from(camera.position());
    }
    let count = cameras.len() as f64;
    let scaled = across * (1.0 / count.max(1.0));
    // 0 for parallel lines, 8 / 27 for lines from all around.
    if scaled.determinant() < 1e-4 {
        return None;
    }
    let point = scaled.inverse() * (sum / count);
    let ahead = (point - DVec3::from(cameras[0].position())).dot(axis(cameras[0], 2));
    Some(point).filter(|point| point.is_finite() && ahead > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(count: usize) -> Vec<Camera> {
        let camera = |i: usize| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / count as f64).sin_cos();
            Camera::look_at([3.0 * sin, 1.5, 3.0 * cos], [0.0, 0.9, 0.2], [0.0, 1.0, 0.0], 0.9, 64, 48)
        };
        (0..count).map(camera).collect()
    }

    #[test]
    fn views_look_at_the_subject_from_elsewhere() {
        let ring = ring(8);
        let cameras: Vec<&Camera> = ring.iter().collect();
        let target = common_point(&cameras).unwrap();
        assert!(target.distance(DVec3::new(0.0, 0.9, 0.2)) < 1e-9, "{target}");
        let views = views(&cameras).unwrap();
        let places = [0, 1, 2, 3].map(|i: usize| DVec3::from(views[i].position()));
        for (view, place) in views.iter().zip(places) {
            view.check().unwrap();
            assert!((target - place).normalize().distance(axis(view, 2)) < 1e-9);
            let nearest = cameras.iter().map(|c| place.distance(c.position().into())).fold(9.0, f64::min);
            assert!(nearest > 0.5, "{place}");
        }
        let [between, above, below, near] = places;
        assert!(above.y > 2.5 && (1.0..2.0).contains(&between.y) && below.y < 0.5, "{places:?}");
        assert!((near.distance(target) - 0.6 * between.distance(target)).abs() < 1e-9);
    }

    #[test]
    fn cameras_without_a_common_point_have_no_views() {
        let ring = ring(8);
        assert!(views(&[]).is_none() && views(&[&ring[0]]).is_none());
        let mut aside = ring[0].clone();
        aside.camera_from_world[0][3] += 1.0;
        assert!(views(&[&ring[0], &aside]).is_none());
    }
}
