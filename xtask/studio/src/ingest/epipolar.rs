//! Checks a calibration against pictures: distances of matched corners from their epipolar lines, and movements of cameras.
//!
//! A match that is right lies on its epipolar line, if the calibration is right. Matches between far views are mostly wrong,
//! and a wrong one lies anywhere. So a pair of cameras only tells something if clearly more matches lie near their lines than
//! when the same corners are paired at random. Distances along the line cannot be seen.
//!
//! A camera's own pictures at the start, in the middle and at the end match easily, and the background that they share shows
//! whether it moved.

use std::collections::BTreeSet;

use codec::Camera;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use refine::capture::Lens;
use serde::{Deserialize, Serialize};

use super::calibration::RigCamera;
use super::features::Features;
use super::pictures::CHECKED;

/// Distance in pixels up to which a match counts as exact.
const EXACT_PX: f64 = 2.0;

/// Distance up to which a match counts as near its line, as a part of the longer side, and at least in pixels.
const NEAR: f64 = 0.02;
const NEAR_MIN_PX: f64 = 6.0;

/// Matches near their lines beyond those by chance, and their ratio, from which on a pair tells something.
const TELLING: f64 = 10.0;
const TELLING_RATIO: f64 = 2.0;

/// Neighbours that each camera is compared with.
const NEIGHBOURS: usize = 2;

/// Median movement in pixels, of pictures of 1000, from which on a camera counts as moved.
pub(super) const MOVED_PX: f64 = 1.5;

/// Matches from which on a movement is believed, and how far it may be, as a part of the longer side.
const MOVED_MATCHES: usize = 12;
const MOVED_MAX: f32 = 0.08;

/// The check of a calibration.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EpipolarCheck {
    /// Neighbouring cameras.
    pub pairs: Vec<EpipolarPair>,
    /// Median movement of each camera in pixels from the start to the middle and to the end; `None` if its pictures do not
    /// match.
    pub moved_px: Vec<[Option<f64>; 2]>,
}

/// Two cameras at several instants.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EpipolarPair {
    /// Numbers of the cameras.
    pub cameras: [usize; 2],
    /// All instants together.
    pub all: EpipolarErrors,
    /// At the start, in the middle, at the end.
    pub instants: Vec<EpipolarErrors>,
}

/// Distances of matches from their epipolar lines.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct EpipolarErrors {
    /// Matches.
    pub matches: usize,
    /// Those near their lines.
    pub near: usize,
    /// As many would be by chance.
    pub by_chance: f64,
    /// Whether the pair tells something.
    pub is_telling: bool,
    /// Median distance in pixels of those near; `None` if the pair tells nothing.
    pub median_px: Option<f64>,
    /// Share of those near that are within 2 px.
    pub exact: Option<f64>,
}

/// Checks `cameras` with the corners in their pictures.
pub(super) fn check(cameras: &[RigCamera], features: &[&[Features]]) -> EpipolarCheck {
    let pairs = neighbours(cameras).into_par_iter().map(|[a, b]| {
        let lines = EpipolarLines::between(&cameras[a], &cameras[b]);
        let near = near_px(&cameras[a].camera).max(near_px(&cameras[b].camera));
        let mut all: (Vec<f64>, Vec<f64>) = Default::default();
        let mut instants = Vec::new();
        for i in 0..CHECKED.len() {
            let (distances, at_random) = distances(&lines, &features[a][i], &features[b][i]);
            instants.push(EpipolarErrors::of(&distances, &at_random, near));
            all.0.extend(distances);
            all.1.extend(at_random);
        }
        EpipolarPair { cameras: [a, b], all: EpipolarErrors::of(&all.0, &all.1, near), instants }
    });
    let moved = cameras.par_iter().zip(features).map(|(camera, features)| {
        [1, 2].map(|later| movement(&camera.camera, &features[0], &features[later]))
    });
    EpipolarCheck { pairs: pairs.collect(), moved_px: moved.collect() }
}

fn near_px(camera: &Camera) -> f64 {
    (NEAR * f64::from(camera.width.max(camera.height))).max(NEAR_MIN_PX)
}

impl EpipolarErrors {
    fn of(distances: &[f64], at_random: &[f64], near_px: f64) -> EpipolarErrors {
        let mut near: Vec<f64> = distances.iter().copied().filter(|x| *x <= near_px).collect();
        near.sort_by(f64::total_cmp);
        let random = at_random.iter().filter(|x| **x <= near_px).count() as f64;
        let by_chance = random * distances.len() as f64 / at_random.len().max(1) as f64;
        let found = near.len() as f64;
        let is_telling = found - by_chance >= TELLING && found >= TELLING_RATIO * by_chance;
        let exact = near.iter().filter(|x| **x <= EXACT_PX).count() as f64 / found;
        EpipolarErrors {
            matches: distances.len(),
            near: near.len(),
            by_chance,
            is_telling,
            median_px: is_telling.then(|| near[near.len() / 2]),
            exact: is_telling.then_some(exact),
        }
    }
}

/// Each camera with those whose directions of view differ least from its own.
fn neighbours(cameras: &[RigCamera]) -> Vec<[usize; 2]> {
    let axis = |i: usize| DVec3::from_slice(&cameras[i].camera.camera_from_world[2]);
    let position = |i: usize| DVec3::from(cameras[i].camera.position());
    let mut pairs = BTreeSet::new();
    for a in 0..cameras.len() {
        // Cameras at one place have no epipolar lines.
        let is_apart = |b: &usize| *b != a && position(a).distance(position(*b)) > 1e-6;
        let mut others: Vec<usize> = (0..cameras.len()).filter(is_apart).collect();
        others.sort_by(|b, c| axis(a).dot(axis(*c)).total_cmp(&axis(a).dot(axis(*b))));
        pairs.extend(others.into_iter().take(NEIGHBOURS).map(|b| [a.min(b), a.max(b)]));
    }
    pairs.into_iter().collect()
}

/// What maps points of a camera to their lines in another, both without lenses.
struct EpipolarLines<'c> {
    cameras: [&'c RigCamera; 2],
    /// The fundamental matrix: lines in the second are this times points of the first.
    fundamental: DMat3,
}

impl EpipolarLines<'_> {
    fn between<'c>(a: &'c RigCamera, b: &'c RigCamera) -> EpipolarLines<'c> {
        let matrix = |rows: [[f64; 3]; 3]| DMat3::from_cols_array_2d(&rows).transpose();
        let rotation = |camera: &Camera| {
            let m = &camera.camera_from_world;
            matrix([0, 1, 2].map(|r| [m[r][0], m[r][1], m[r][2]]))
        };
        let translation = |camera: &Camera| DVec3::from([0, 1, 2].map(|r| camera.camera_from_world[r][3]));
        let turn = rotation(&b.camera) * rotation(&a.camera).transpose();
        let t = translation(&b.camera) - turn * translation(&a.camera);
        let cross = matrix([[0.0, -t.z, t.y], [t.z, 0.0, -t.x], [-t.y, t.x, 0.0]]);
        let [ka, kb] = [a, b].map(|camera| matrix(camera.camera.k).inverse());
        EpipolarLines { cameras: [a, b], fundamental: kb.transpose() * cross * turn * ka }
    }

    /// Distance in pixels of two points from each other's lines, the larger.
    fn distance(&self, [p, q]: [DVec3; 2]) -> f64 {
        let of = |line: DVec3, point: DVec3| line.dot(point).abs() / line.x.hypot(line.y).max(1e-300);
        of(self.fundamental * p, q).max(of(self.fundamental.transpose() * q, p))
    }
}

/// Distances of the matches, and of their corners paired at random.
fn distances(lines: &EpipolarLines, a: &Features, b: &Features) -> (Vec<f64>, Vec<f64>) {
    let place = |camera: usize, point: [f32; 2]| undistorted(lines.cameras[camera], point);
    let matches: Vec<[DVec3; 2]> = a
        .matches(b, |_, _| true)
        .into_iter()
        .filter_map(|[i, j]| Some([place(0, a.points[i])?, place(1, b.points[j])?]))
        .collect();
    let count = matches.len();
    // Each with several others, so that chance is known better than by as many pairs.
    let shifts = (1..count).step_by((count / 8).max(1));
    let at_random = shifts.flat_map(|shift| {
        let matches = &matches;
        (0..count).map(move |i| lines.distance([matches[i][0], matches[(i + shift) % count][1]]))
    });
    (matches.iter().map(|pair| lines.distance(*pair)).collect(), at_random.collect())
}

/// The point of a picture without its lens, in pixels.
fn undistorted(RigCamera { camera, lens, .. }: &RigCamera, [x, y]: [f32; 2]) -> Option<DVec3> {
    let [fx, fy, cx, cy] = [camera.k[0][0], camera.k[1][1], camera.k[0][2], camera.k[1][2]];
    let [u, v] = straight(lens, [(f64::from(x) - cx) / fx, (f64::from(y) - cy) / fy])?;
    Some(DVec3::new(u * fx + cx, v * fy + cy, 1.0))
}

/// Inverts the distortion of a lens: a step of the error leads closer as long as it distorts less than it shows.
fn straight(lens: &Lens, bent: [f64; 2]) -> Option<[f64; 2]> {
    let mut point = bent;
    for _ in 0..50 {
        let [x, y] = lens.distort(point)?;
        let error = [bent[0] - x, bent[1] - y];
        point = [point[0] + error[0], point[1] + error[1]];
        if error[0].abs().max(error[1].abs()) < 1e-9 {
            return Some(point);
        }
    }
    None
}

/// Median movement in pixels of the corners of one camera between two pictures.
fn movement(camera: &Camera, first: &Features, later: &Features) -> Option<f64> {
    let side = camera.width.max(camera.height) as f32;
    let apart = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let matches = first.matches(later, |a, b| apart(a, b) < MOVED_MAX * side);
    let by = |axis: usize| {
        let difference = |[i, j]: &[usize; 2]| f64::from(later.points[*j][axis] - first.points[*i][axis]);
        let mut moved: Vec<f64> = matches.iter().map(difference).collect();
        moved.sort_by(f64::total_cmp);
        moved[moved.len() / 2]
    };
    (matches.len() >= MOVED_MATCHES).then(|| by(0).hypot(by(1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(position: [f64; 3], lens: &[f64]) -> RigCamera {
        let camera = Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.8, 640, 480);
        RigCamera { name: String::new(), camera, lens: Lens::rational(lens).unwrap() }
    }

    /// A point of the world in a picture, through the lens.
    fn seen(camera: &RigCamera, point: [f64; 3]) -> [f32; 2] {
        let m = &camera.camera.camera_from_world;
        let [x, y, z] = [0, 1, 2].map(|r| (0..3).map(|c| m[r][c] * point[c]).sum::<f64>() + m[r][3]);
        let bent = camera.lens.distort([x / z, y / z]).unwrap();
        [0, 1].map(|axis| (bent[axis] * camera.camera.k[axis][axis] + camera.camera.k[axis][2]) as f32)
    }

    #[test]
    fn a_point_lies_on_its_line_through_a_lens() {
        let cameras = [camera([0.5, 1.0, 3.0], &[-0.1, 0.02]), camera([-2.0, 0.3, 2.0], &[0.05, 0.0, 1e-3])];
        let lines = EpipolarLines::between(&cameras[0], &cameras[1]);
        let mut moved = cameras[1].clone();
        moved.camera.camera_from_world[1][3] += 0.05;
        let wrong = EpipolarLines::between(&cameras[0], &moved);
        for point in [[0.0; 3], [0.3, 0.2, -0.4], [-0.5, 0.6, 0.1]] {
            let places = [0, 1].map(|i| undistorted(&cameras[i], seen(&cameras[i], point)).unwrap());
            assert!(lines.distance(places) < 1e-3, "{}", lines.distance(places));
            assert!(wrong.distance(places) > 3.0, "{}", wrong.distance(places));
        }
    }

    #[test]
    fn chance_tells_nothing() {
        let even: Vec<f64> = (0..200).map(f64::from).collect();
        let chance = EpipolarErrors::of(&even, &even, 10.0);
        assert!(!chance.is_telling && chance.median_px.is_none(), "{chance:?}");
        let right: Vec<f64> = (0..40).map(|i| 0.05 * f64::from(i)).chain(even.clone()).collect();
        let told = EpipolarErrors::of(&right, &even, 10.0);
        assert!(told.is_telling && told.median_px.unwrap() < 2.5, "{told:?}");
    }

    #[test]
    fn neighbours_look_in_similar_directions() {
        let ring = (0..6).map(|i| {
            let (sin, cos) = libm::sincos(f64::from(i) * std::f64::consts::TAU / 6.0);
            camera([3.0 * sin, 1.0, 3.0 * cos], &[])
        });
        let pairs = neighbours(&ring.collect::<Vec<_>>());
        assert_eq!(pairs, [[0, 1], [0, 5], [1, 2], [2, 3], [3, 4], [4, 5]]);
        assert!(neighbours(&[camera([0.0, 0.0, 3.0], &[])]).is_empty());
    }
}
