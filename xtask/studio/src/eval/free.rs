//! [`free_views`]: pictures from new viewpoints (the paper's appendix "The Transmitted Package
//! from Free Viewpoints").
//!
//! Between two neighbouring cameras a field is seen from where no photograph tells whether it is right: floaters that hide
//! from every camera show there.

use codec::Camera;
use glam::{DMat3, DQuat, DVec3};
use refine::capture::common_point;
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

/// Most views between cameras.
const BETWEEN_MAX: usize = 4;

/// Two poses that are less apart are the same, see [`Rig::apart`].
const APART_MIN: f64 = 1e-3;

/// Renders `input` at clip time `t` in up to two rows: halfway between neighbouring fitted cameras, up to four times, spread
/// over the rig; then from above, below and near, if the cameras look at a common point. `None` without any view.
pub fn free_views(input: &Input, capture_files: &CaptureFiles, t: f64) -> Option<Image> {
    let cameras: Vec<&Camera> = capture_files
        .capture
        .cameras
        .iter()
        .filter(|camera| !camera.held)
        .map(|camera| &camera.camera)
        .collect();
    let draw = |camera: &Camera| reference::render(&input.to_reference(), camera, t, Order::Depth);
    let others = views(&cameras).map_or(Vec::new(), Vec::from);
    let rows: Vec<Vec<Image>> = [Rig::new(&cameras).between(), others]
        .iter()
        .filter(|row| !row.is_empty())
        .map(|row| row.iter().map(draw).collect())
        .collect();
    (!rows.is_empty()).then(|| sheet(&filled(rows)))
}

/// The rows with black pixels and pictures, so that all pictures are of one size, and all rows of one length.
fn filled(mut rows: Vec<Vec<Image>>) -> Vec<Vec<Image>> {
    let largest = |side: fn(&Image) -> u32| rows.iter().flatten().map(side).max().unwrap_or(1);
    let (width, height) = (largest(|image| image.width), largest(|image| image.height));
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    for row in &mut rows {
        for image in row.iter_mut().filter(|image| (image.width, image.height) != (width, height)) {
            let mut whole = Image::new(width, height);
            let lines = whole.pixels.chunks_mut(width as usize);
            for (line, pixels) in lines.zip(image.pixels.chunks(image.width as usize)) {
                line[..pixels.len()].copy_from_slice(pixels);
            }
            *image = whole;
        }
        row.resize_with(columns, || Image::new(width, height));
    }
    rows
}

/// Cameras, and the size of their rig.
struct Rig<'a> {
    cameras: &'a [&'a Camera],
    /// Mean distance of the cameras from their centre.
    radius: f64,
}

impl Rig<'_> {
    fn new<'a>(cameras: &'a [&'a Camera]) -> Rig<'a> {
        let count = cameras.len().max(1) as f64;
        let position = |camera: &&Camera| DVec3::from(camera.position());
        let center = cameras.iter().map(position).sum::<DVec3>() / count;
        let radius = cameras.iter().map(|camera| center.distance(position(camera))).sum::<f64>() / count;
        Rig { cameras, radius }
    }

    /// How far two poses are apart: the distance in radii of the rig, and the angle between the lines of sight in radians.
    fn apart(&self, a: &Camera, b: &Camera) -> f64 {
        let distance = DVec3::from(a.position()).distance(b.position().into());
        let angle = axis(a, 2).angle_between(axis(b, 2));
        // At one place, only directions differ.
        angle + if self.radius > 0.0 { distance / self.radius } else { 0.0 }
    }

    /// Views halfway between cameras and their nearest neighbours, the first camera's first, then each as far from those
    /// before it as there is one.
    fn between(&self) -> Vec<Camera> {
        let mut pairs: Vec<[usize; 2]> = Vec::new();
        for (i, camera) in self.cameras.iter().enumerate() {
            let others = self.cameras.iter().enumerate().map(|(j, other)| (j, self.apart(camera, other)));
            let neighbour =
                others.filter(|(_, apart)| *apart > APART_MIN).min_by(|(_, a), (_, b)| a.total_cmp(b));
            if let Some((j, _)) = neighbour {
                pairs.push([i.min(j), i.max(j)]);
            }
        }
        let first = pairs.first().copied();
        pairs.sort_unstable();
        pairs.dedup();
        let mut left: Vec<Camera> =
            pairs.iter().filter(|pair| Some(**pair) != first).map(|pair| self.middle(*pair)).collect();
        let mut chosen: Vec<Camera> = first.map(|pair| self.middle(pair)).into_iter().collect();
        while chosen.len() < BETWEEN_MAX && !left.is_empty() {
            let nearest = |view: &Camera| {
                chosen.iter().map(|other| self.apart(view, other)).fold(f64::INFINITY, f64::min)
            };
            let farthest = (0..left.len()).max_by(|i, j| nearest(&left[*i]).total_cmp(&nearest(&left[*j])));
            chosen.push(left.remove(farthest.expect("one is left")));
        }
        chosen
    }

    /// The camera halfway between two: position, orientation and intrinsics.
    fn middle(&self, pair: [usize; 2]) -> Camera {
        let [a, b] = pair.map(|i| self.cameras[i]);
        let orientation = |camera: &Camera| {
            let rows = DMat3::from_cols(axis(camera, 0), axis(camera, 1), axis(camera, 2));
            DQuat::from_mat3(&rows.transpose()).normalize()
        };
        let turn = DMat3::from_quat(orientation(a).slerp(orientation(b), 0.5));
        let position = DVec3::from(a.position()).midpoint(b.position().into());
        let offset = turn * -position;
        let rows = turn.transpose();
        let row = |axis: DVec3, offset: f64| [axis.x, axis.y, axis.z, offset];
        Camera {
            width: a.width.midpoint(b.width),
            height: a.height.midpoint(b.height),
            k: std::array::from_fn(|r| std::array::from_fn(|c| a.k[r][c].midpoint(b.k[r][c]))),
            camera_from_world: [
                row(rows.x_axis, offset.x),
                row(rows.y_axis, offset.y),
                row(rows.z_axis, offset.z),
                [0.0, 0.0, 0.0, 1.0],
            ],
        }
    }
}

/// Views from above, below and near the place between the first camera and its nearest neighbour in direction.
fn views(cameras: &[&Camera]) -> Option<[Camera; 3]> {
    let target = common_point(cameras.iter().copied())?;
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
    Some([raised(RAISED), raised(-RAISED), NEAR * between].map(view))
}

/// An axis of a camera in the world: x right, y down, z forward.
fn axis(camera: &Camera, row: usize) -> DVec3 {
    let [x, y, z, _] = camera.camera_from_world[row];
    DVec3::new(x, y, z)
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
        let target = common_point(cameras.iter().copied()).unwrap();
        assert!(target.distance(DVec3::new(0.0, 0.9, 0.2)) < 1e-9, "{target}");
        let views = views(&cameras).unwrap();
        let places = [0, 1, 2].map(|i: usize| DVec3::from(views[i].position()));
        for (view, place) in views.iter().zip(places) {
            view.check().unwrap();
            assert!((target - place).normalize().distance(axis(view, 2)) < 1e-9);
            let nearest = cameras.iter().map(|c| place.distance(c.position().into())).fold(9.0, f64::min);
            assert!(nearest > 0.5, "{place}");
        }
        let [above, below, near] = places;
        assert!(above.y > 2.5 && (1.0..2.0).contains(&near.y) && below.y < 0.5, "{places:?}");
        let distances = [cameras[0], cameras[1]].map(|camera| target.distance(camera.position().into()));
        let mean = 0.5 * (distances[0] + distances[1]);
        assert!((near.distance(target) - 0.6 * mean).abs() < 1e-9);
    }

    #[test]
    fn views_are_halfway_between_neighbours_and_spread_over_the_rig() {
        let mut ring = ring(8);
        // A larger photograph with a longer lens.
        ring[1] = ring[1].resized(128, 96);
        let cameras: Vec<&Camera> = ring.iter().collect();
        let views = Rig::new(&cameras).between();
        assert_eq!(views.len(), 4);
        for view in &views {
            view.check().unwrap();
            let place = DVec3::from(view.position());
            let mut near: Vec<&&Camera> = cameras.iter().collect();
            let distance = |camera: &Camera| place.distance(camera.position().into());
            near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            let [a, b] = [near[0], near[1]];
            assert!((place - DVec3::from(a.position()).midpoint(b.position().into())).length() < 1e-9);
            // Turned halfway from one camera to the other.
            let [from, to] = [a, b].map(|camera| axis(camera, 2).angle_between(axis(view, 2)));
            let whole = axis(a, 2).angle_between(axis(b, 2));
            assert!((from - 0.5 * whole).abs() < 1e-3 && (to - 0.5 * whole).abs() < 1e-3, "{from} {to}");
            assert!(axis(view, 1).dot(axis(a, 1)) > 0.9, "it stands upright");
            assert!((view.k[1][1] - 0.5 * (a.k[1][1] + b.k[1][1])).abs() < 1e-9);
        }
        let places = views.iter().map(|view| DVec3::from(view.position()));
        let places: Vec<DVec3> = places.collect();
        for (i, place) in places.iter().enumerate() {
            let nearest = places[..i].iter().map(|other| place.distance(*other)).fold(9.0, f64::min);
            assert!(nearest > 2.0, "{places:?}");
        }
    }

    #[test]
    fn pictures_of_many_sizes_make_whole_rows() {
        let rows = filled(vec![vec![Image::new(4, 2), Image::new(3, 5)], vec![Image::new(2, 2)]]);
        assert!(rows.iter().all(|row| row.len() == 2));
        assert!(rows.iter().flatten().all(|image| (image.width, image.height) == (4, 5)));
        assert_eq!(sheet(&rows).height, 10);
    }

    #[test]
    fn cameras_without_a_common_point_have_no_views() {
        let ring = ring(8);
        assert!(views(&[]).is_none() && views(&[&ring[0]]).is_none());
        let mut aside = ring[0].clone();
        aside.camera_from_world[0][3] += 1.0;
        assert!(views(&[&ring[0], &aside]).is_none());
        assert_eq!(Rig::new(&[&ring[0], &aside]).between().len(), 1, "there is a place between them");
        assert!(Rig::new(&[]).between().is_empty() && Rig::new(&[&ring[0], &ring[0]]).between().is_empty());
    }
}
