//! Checks a calibration against pictures: distances of matched corners from their epipolar lines, and movements of cameras.
//!
//! Each corner is compared with the corners of the other picture in a wide band around its epipolar line. Wrong
//! matches, which are most of them between far views, lie anywhere in the band; right ones lie on the line, if the
//! calibration is right. So a pair of cameras tells something if clearly more matches lie near the line than the rest
//! of the band lets expect, and that many are left out of the median. An error along the line, or one beyond the band,
//! cannot be seen.
//!
//! A camera's own pictures at the start, in the middle and at the end match easily, and the background that they share shows
//! whether it moved.

use std::collections::BTreeSet;

use codec::Camera;
use glam::{DMat2, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use refine::capture::Lens;
use refine::metrics::median;
use serde::{Deserialize, Serialize};

use super::calibration::RigCamera;
use super::features::Features;
use super::pictures::CHECKED;

/// Distance in pixels up to which a match counts as exact.
const EXACT_PX: f64 = 2.0;

/// Half the width of the band, as a part of the longer side, and the part of it that counts as near the line.
const BAND: f64 = 0.04;
const NEAR: f64 = 0.25;

/// Matches near the line beyond those by chance from which on a pair tells something, and how many standard deviations they
/// have to be.
const TELLING: f64 = 8.0;
const TELLING_DEVIATIONS: f64 = 4.0;

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
    /// Matches in the band.
    pub matches: usize,
    /// Those near their lines, within a quarter of the band.
    pub near: usize,
    /// As many would be by chance.
    pub by_chance: f64,
    /// Whether the pair tells something.
    pub is_telling: bool,
    /// Median distance in pixels of those near, without as many as there are by chance; `None` if the pair tells nothing.
    pub median_px: Option<f64>,
    /// Share of those near that are within 2 px.
    pub exact: Option<f64>,
}

/// Checks `cameras` with the corners in their pictures.
pub(super) fn check(cameras: &[RigCamera], features: &[&[Features]]) -> EpipolarCheck {
    let pairs = neighbours(cameras).into_par_iter().map(|[a, b]| {
        let lines = EpipolarLines::between(&cameras[a], &cameras[b]);
        let band_px = [a, b].map(|camera| band_px(&cameras[camera].camera)).into_iter().fold(0.0, f64::max);
        let distances: Vec<Vec<f64>> =
            (0..CHECKED.len()).map(|i| lines.distances(&features[a][i], &features[b][i], band_px)).collect();
        let instants = distances.iter().map(|distances| EpipolarErrors::new(distances, band_px)).collect();
        EpipolarPair { cameras: [a, b], all: EpipolarErrors::new(&distances.concat(), band_px), instants }
    });
    let moved = cameras.par_iter().zip(features).map(|(camera, features)| {
        [1, 2].map(|later| movement(&camera.camera, &features[0], &features[later]))
    });
    EpipolarCheck { pairs: pairs.collect(), moved_px: moved.collect() }
}

fn band_px(camera: &Camera) -> f64 {
    BAND * f64::from(camera.width.max(camera.height))
}

impl EpipolarErrors {
    /// Of distances that are at most `band_px`.
    fn new(distances: &[f64], band_px: f64) -> EpipolarErrors {
        let near_px = NEAR * band_px;
        let mut near: Vec<f64> = distances.iter().copied().filter(|x| *x <= near_px).collect();
        near.sort_by(f64::total_cmp);
        // Wrong matches are as dense near the line as elsewhere in the band.
        let per_px = (distances.len() - near.len()) as f64 / (band_px - near_px);
        let by_chance = near_px * per_px;
        let right = near.len() as f64 - by_chance;
        let is_telling = right >= TELLING && right >= TELLING_DEVIATIONS * (by_chance + 1.0).sqrt();
        let right_within = |count: usize, px: f64| count as f64 - px * per_px;
        let median = near.iter().enumerate().find(|(i, px)| right_within(i + 1, **px) >= 0.5 * right);
        let exact = near.iter().filter(|px| **px <= EXACT_PX).count();
        EpipolarErrors {
            matches: distances.len(),
            near: near.len(),
            by_chance,
            is_telling,
            median_px: median.filter(|_| is_telling).map(|(_, px)| *px),
            exact: is_telling.then(|| (right_within(exact, EXACT_PX.min(near_px)) / right).clamp(0.0, 1.0)),
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

    /// Distance in pixels of two points from each other's lines, the larger: how far each would have to move in its picture,
    /// with the lens, to be on its line.
    fn distance(&self, [p, q]: [&Straight; 2]) -> f64 {
        let distance_to_line = |line: DVec3, point: &Straight| {
            let normal = DVec2::new(line.x, line.y);
            line.dot(point.at.extend(1.0)).abs() / (point.by_bent.transpose() * normal).length().max(1e-300)
        };
        let (of_p, of_q) =
            (self.fundamental * p.at.extend(1.0), self.fundamental.transpose() * q.at.extend(1.0));
        distance_to_line(of_p, q).max(distance_to_line(of_q, p))
    }

    /// Distances of the matches within the band.
    fn distances(&self, a: &Features, b: &Features, band_px: f64) -> Vec<f64> {
        let place = |camera: usize, features: &Features| -> Vec<Option<Straight>> {
            features.points.iter().map(|point| Straight::new(self.cameras[camera], *point)).collect()
        };
        let (of_a, of_b) = (place(0, a), place(1, b));
        let distance = |i: usize, j: usize| Some(self.distance([of_a[i].as_ref()?, of_b[j].as_ref()?]));
        let matches = a.matches(b, |i, j| distance(i, j).is_some_and(|px| px <= band_px));
        matches.into_iter().filter_map(|[i, j]| distance(i, j)).collect()
    }
}

/// A point of a picture without its lens, in pixels.
struct Straight {
    at: DVec2,
    /// How it moves as the point in the picture does. Far off the axis of a fisheye lens it moves many times as far.
    by_bent: DMat2,
}

impl Straight {
    /// The point `place` of a picture; `None` beyond the end of the lens.
    fn new(RigCamera { camera, lens, .. }: &RigCamera, place: [f32; 2]) -> Option<Straight> {
        let focal = DVec2::new(camera.k[0][0], camera.k[1][1]);
        let center = DVec2::new(camera.k[0][2], camera.k[1][2]);
        let bent = (DVec2::from(place.map(f64::from)) - center) / focal;
        let (straight, by_bent) = straight(lens, bent)?;
        let scale = DMat2::from_diagonal(focal);
        Some(Straight { at: straight * focal + center, by_bent: scale * by_bent * scale.inverse() })
    }
}

/// Inverts the distortion of a lens by Newton's method: the point, and its derivative by the distorted point.
fn straight(lens: &Lens, bent: DVec2) -> Option<(DVec2, DMat2)> {
    let distort = |point: DVec2| lens.distort(point.to_array()).map(DVec2::from);
    // The axis is in every lens.
    let mut point = DVec2::ZERO;
    let mut error = bent - distort(point)?;
    for _ in 0..50 {
        let step = 1e-6 * (1.0 + point.length());
        let slope = |axis: DVec2| {
            Some((distort(point + step * axis)? - distort(point - step * axis)?) / (2.0 * step))
        };
        let by_bent = DMat2::from_cols(slope(DVec2::X)?, slope(DVec2::Y)?).inverse();
        if !by_bent.is_finite() {
            return None;
        }
        if error.length() < 1e-9 {
            return Some((point, by_bent));
        }
        // A step that leads away, or out of the lens, is too long.
        let shorter = |halvings: i32| {
            let next = point + 0.5f64.powi(halvings) * (by_bent * error);
            let next_error = bent - distort(next)?;
            (next_error.length() < error.length()).then_some((next, next_error))
        };
        (point, error) = (0..30).find_map(shorter)?;
    }
    None
}

/// Median movement in pixels of the corners of one camera between two pictures.
fn movement(camera: &Camera, first: &Features, later: &Features) -> Option<f64> {
    let side = camera.width.max(camera.height) as f32;
    let apart = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let matches = first.matches(later, |i, j| apart(first.points[i], later.points[j]) < MOVED_MAX * side);
    let by = |axis: usize| {
        let difference = |[i, j]: &[usize; 2]| f64::from(later.points[*j][axis] - first.points[*i][axis]);
        median(matches.iter().map(difference).collect())
    };
    let moved = by(0)?.hypot(by(1)?);
    (matches.len() >= MOVED_MATCHES).then_some(moved)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(position: [f64; 3], lens: Lens) -> RigCamera {
        let camera = Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.8, 640, 480);
        RigCamera { name: String::new(), camera, lens }
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
        let lenses = |a: &[f64], b: &[f64], make: fn(&[f64]) -> Result<Lens, String>| {
            [([0.5, 1.0, 3.0], a), ([-2.0, 0.3, 2.0], b)].map(|(at, k)| camera(at, make(k).unwrap()))
        };
        for cameras in [
            lenses(&[-0.1, 0.02], &[0.05, 0.0, 1e-3], Lens::rational),
            lenses(
                &[-0.35, 0.2, 2e-3, -1e-3, -0.05],
                &[8.0, 3.0, 0.0, 0.0, 0.1, 8.5, 6.0, 0.8],
                Lens::rational,
            ),
            lenses(&[], &[-0.02, 5e-3, -2e-3, 1e-4], Lens::fisheye),
        ] {
            let lines = EpipolarLines::between(&cameras[0], &cameras[1]);
            let place = |i: usize, place: [f32; 2]| Straight::new(&cameras[i], place).unwrap();
            for point in [[0.0; 3], [0.3, 0.2, -0.4], [-0.5, 0.6, 0.1]] {
                let places = [0, 1].map(|i| seen(&cameras[i], point));
                let distance = |[p, q]: [[f32; 2]; 2]| lines.distance([&place(0, p), &place(1, q)]);
                assert!(distance(places) < 1e-3, "{}", distance(places));
                // The base runs mostly along x, so the lines do.
                let [p, [x, y]] = places;
                let off = distance([p, [x, y + 4.0]]);
                assert!((2.0..6.0).contains(&off), "{off}");
            }
        }
    }

    #[test]
    fn a_lens_is_inverted_up_to_its_edge() {
        let rational = |k: &[f64]| Lens::rational(k).unwrap();
        let fisheye = |k: &[f64]| Lens::fisheye(k).unwrap();
        for (lens, degrees) in [
            (fisheye(&[]), 88.0),
            (fisheye(&[-0.02, 5e-3, -2e-3, 1e-4]), 85.0),
            (fisheye(&[0.08, -0.02, 4e-3, -3e-4]), 85.0),
            (rational(&[-0.35, 0.2, 2e-3, -1e-3, -0.05]), 40.0),
            (rational(&[8.0, 3.0, 0.0, 0.0, 0.1, 8.5, 6.0, 0.8]), 75.0),
            (rational(&[0.4]), 45.0),
        ] {
            for step in 0..=20 {
                let (sin, cos) = libm::sincos(f64::from(step));
                let point = libm::tan(0.05 * f64::from(step) * degrees * std::f64::consts::PI / 180.0)
                    * DVec2::new(cos, sin);
                let bent = lens.distort(point.to_array()).unwrap();
                let (found, _) = straight(&lens, bent.into()).unwrap_or_else(|| panic!("{lens:?} {point}"));
                assert!(
                    found.distance(point) < 1e-6 * (1.0 + point.length_squared()),
                    "{lens:?}: {found}, not {point}"
                );
            }
        }
        // r - 0.1 r^3 shows nothing beyond 1.2171.
        assert!(straight(&rational(&[-0.1]), DVec2::new(1.23, 0.0)).is_none());
    }

    #[test]
    fn chance_tells_nothing() {
        let even: Vec<f64> = (0..200).map(|i| 0.2 * f64::from(i)).collect();
        let chance = EpipolarErrors::new(&even, 40.0);
        assert!(!chance.is_telling && chance.median_px.is_none(), "{chance:?}");
        // Chance does not bend the median of what is right.
        let right: Vec<f64> = (0..60).map(|i| 0.05 * f64::from(i)).chain(even).collect();
        let told = EpipolarErrors::new(&right, 40.0);
        assert!(told.is_telling && (told.median_px.unwrap() - 1.5).abs() < 0.2, "{told:?}");
        assert!((told.exact.unwrap() - 2.0 / 3.0).abs() < 0.1, "{told:?}");
        assert!(!EpipolarErrors::new(&[], 40.0).is_telling);
    }

    #[test]
    fn neighbours_look_in_similar_directions() {
        let ring = (0..6).map(|i| {
            let (sin, cos) = libm::sincos(f64::from(i) * std::f64::consts::TAU / 6.0);
            camera([3.0 * sin, 1.0, 3.0 * cos], Lens::default())
        });
        let pairs = neighbours(&ring.collect::<Vec<_>>());
        assert_eq!(pairs, [[0, 1], [0, 5], [1, 2], [2, 3], [3, 4], [4, 5]]);
        assert!(neighbours(&[camera([0.0, 0.0, 3.0], Lens::default())]).is_empty());
    }
}
