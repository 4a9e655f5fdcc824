//! [`register`]: how the points of a surface move to the surface of another frame.
//!
//! Neither pictures nor points say which point became which: surfaces have little texture, and each frame samples its
//! own points. So each point of the target is shared among the points of the source by distance and colour, as in
//! coherent point drift (Myronenko and Song, "Point set registration: coherent point drift", 2010), and each point of
//! the source moves rigidly with its neighbourhood (as in Sorkine and Alexa, "As-rigid-as-possible surface modeling",
//! 2007). The neighbourhoods shrink from the whole surface to a part of it, and the distances over which points are
//! shared with them: a body turns as a whole before its arm does.

use glam::{DMat3, DQuat, DVec3};

/// Radii of the neighbourhoods, in sizes of the source, from coarse to fine. The first contains all points.
const RADII: [f64; 6] = [20.0, 1.2, 0.6, 0.4, 0.28, 0.2];

/// Iterations with each radius.
const ITERATIONS: usize = 8;

/// Standard deviation of the distance over which a point of the target is shared, in sizes of the source, at the
/// start and at the end.
const SHARING: [f64; 2] = [0.5, 0.04];

/// Standard deviation of the difference of colours between a point and itself in another frame, for channels from 0
/// to 1.
const COLOR: f64 = 0.15;

/// A point of the target whose likelihoods sum to less than this belongs to no point of the source.
const UNMATCHED: f64 = 0.2;

/// Exponent beyond which a weight is 0.
const NEGLIGIBLE: f64 = 12.0;

/// Points of a surface.
#[derive(Clone, Debug, Default)]
pub(super) struct SurfacePoints {
    pub(super) positions: Vec<DVec3>,
    /// Red, green and blue, about 0 to 1.
    pub(super) colors: Vec<DVec3>,
}

impl SurfacePoints {
    /// Root of the mean squared distance from the mean, in units of the capture.
    fn size(&self) -> f64 {
        let count = self.positions.len().max(1) as f64;
        let mean = self.positions.iter().sum::<DVec3>() / count;
        (self.positions.iter().map(|point| point.distance_squared(mean)).sum::<f64>() / count).sqrt()
    }
}

/// A rotation about the origin, then a shift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RigidMotion {
    pub(super) rotation: DQuat,
    pub(super) shift: DVec3,
}

impl RigidMotion {
    const NONE: RigidMotion = RigidMotion { rotation: DQuat::IDENTITY, shift: DVec3::ZERO };

    /// Where a point moves to.
    pub(super) fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.shift
    }
}

/// The motion of each point of `source` to the surface of `target`. Nothing moves if either has no extent.
pub(super) fn register(source: &SurfacePoints, target: &SurfacePoints) -> Vec<RigidMotion> {
    let mut motions = vec![RigidMotion::NONE; source.positions.len()];
    let size = source.size();
    if !size.is_normal() || target.positions.is_empty() {
        return motions;
    }
    let last = (RADII.len() * ITERATIONS - 1) as f64;
    for (level, radius) in RADII.iter().enumerate() {
        let neighborhoods = neighborhoods(&source.positions, radius * size);
        for iteration in 0..ITERATIONS {
            let progress = (level * ITERATIONS + iteration) as f64 / last;
            let sharing = size * SHARING[0] * libm::pow(SHARING[1] / SHARING[0], progress);
            let moved: Vec<DVec3> =
                motions.iter().zip(&source.positions).map(|(motion, point)| motion.apply(*point)).collect();
            let matches = share(&moved, source, target, sharing);
            for (motion, neighborhood) in motions.iter_mut().zip(&neighborhoods) {
                *motion = fit_rigid(*motion, neighborhood, &source.positions, &matches);
            }
        }
    }
    motions
}

/// The points near each point, with their weights.
fn neighborhoods(points: &[DVec3], radius: f64) -> Vec<Vec<(usize, f64)>> {
    let near = |point: &DVec3| {
        let weights = points.iter().map(|other| 0.5 * point.distance_squared(*other) / (radius * radius));
        let near = weights.enumerate().filter(|(_, exponent)| *exponent < NEGLIGIBLE);
        near.map(|(i, exponent)| (i, libm::exp(-exponent))).collect()
    };
    points.iter().map(near).collect()
}

/// Where a point of the source should move to, and how much of the target that stands for.
#[derive(Clone, Copy)]
struct Match {
    position: DVec3,
    weight: f64,
}

/// Shares each point of the target among the points of the source, which have `moved`.
fn share(moved: &[DVec3], source: &SurfacePoints, target: &SurfacePoints, sharing: f64) -> Vec<Match> {
    let mut sums = vec![Match { position: DVec3::ZERO, weight: 0.0 }; moved.len()];
    let [by_distance, by_color] = [sharing, COLOR].map(|deviation| 0.5 / (deviation * deviation));
    let mut likelihoods = Vec::new();
    for (point, color) in target.positions.iter().zip(&target.colors) {
        likelihoods.clear();
        for (i, (position, own)) in moved.iter().zip(&source.colors).enumerate() {
            let exponent =
                by_distance * position.distance_squared(*point) + by_color * own.distance_squared(*color);
            if exponent < NEGLIGIBLE {
                likelihoods.push((i, libm::exp(-exponent)));
            }
        }
        let total = UNMATCHED + likelihoods.iter().map(|(_, likelihood)| likelihood).sum::<f64>();
        for (i, likelihood) in &likelihoods {
            let weight = likelihood / total;
            sums[*i].weight += weight;
            sums[*i].position += weight * point;
        }
    }
    for sum in &mut sums {
        sum.position /= sum.weight.max(f64::MIN_POSITIVE);
    }
    sums
}

/// The rigid motion that brings the points of a neighbourhood closest to their matches; `last` where nothing matches.
fn fit_rigid(
    last: RigidMotion,
    neighborhood: &[(usize, f64)],
    points: &[DVec3],
    matches: &[Match],
) -> RigidMotion {
    let weighted = || neighborhood.iter().map(|(i, weight)| (weight * matches[*i].weight, *i));
    let total: f64 = weighted().map(|(weight, _)| weight).sum();
    if total < 1e-9 {
        return last;
    }
    let [mut from, mut to] = [DVec3::ZERO; 2];
    for (weight, i) in weighted() {
        from += weight / total * points[i];
        to += weight / total * matches[i].position;
    }
    let mut covariance = DMat3::ZERO;
    for (weight, i) in weighted() {
        let (before, after) = (points[i] - from, weight * (matches[i].position - to));
        covariance += DMat3::from_cols(after * before.x, after * before.y, after * before.z);
    }
    let rotation = extract_rotation(covariance, last.rotation);
    RigidMotion { rotation, shift: to - rotation * from }
}

/// The rotation closest to a matrix, from a guess (Müller et al., "A robust method to extract the rotational part of
/// deformations", 2016). Where the matrix does not determine the rotation, as for points on a line, the guess does.
fn extract_rotation(matrix: DMat3, guess: DQuat) -> DQuat {
    let mut rotation = guess;
    for _ in 0..10 {
        let axes = DMat3::from_quat(rotation);
        let pairs =
            [(axes.x_axis, matrix.x_axis), (axes.y_axis, matrix.y_axis), (axes.z_axis, matrix.z_axis)];
        let torque: DVec3 = pairs.iter().map(|(axis, column)| axis.cross(*column)).sum();
        let alignment: f64 = pairs.iter().map(|(axis, column)| axis.dot(*column)).sum();
        let turn = torque / (alignment.abs() + f64::MIN_POSITIVE);
        if !turn.is_finite() || turn.length() < 1e-9 {
            break;
        }
        rotation = (DQuat::from_scaled_axis(turn) * rotation).normalize();
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;

    /// About `count` points on two boxes: a body, and a bar at its side that is turned by `angle` about an axis
    /// through its near end. `seed` chooses the points.
    fn figure(count: usize, angle: f64, seed: u64) -> SurfacePoints {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut on_box = |half: DVec3| {
            let mut point = half * DVec3::from_array(std::array::from_fn(|_| 2.0 * random.f64() - 1.0));
            let axis = random.usize(0..3);
            point[axis] = if random.bool() { half[axis] } else { -half[axis] };
            point
        };
        let turn = DQuat::from_rotation_z(angle);
        let mut points = SurfacePoints::default();
        for i in 0..count {
            let is_body = !i.is_multiple_of(4);
            points.positions.push(match is_body {
                true => on_box(DVec3::new(0.3, 0.6, 0.2)),
                false => {
                    DVec3::new(0.35, 0.2, 0.0) + turn * (on_box(DVec3::new(0.3, 0.05, 0.05)) + 0.3 * DVec3::X)
                }
            });
            points.colors.push(if is_body { DVec3::splat(0.5) } else { DVec3::new(0.6, 0.5, 0.4) });
        }
        points
    }

    fn moved(points: &SurfacePoints, by: RigidMotion) -> SurfacePoints {
        SurfacePoints {
            positions: points.positions.iter().map(|point| by.apply(*point)).collect(),
            ..points.clone()
        }
    }

    /// The figure turns by 30 degrees, goes a third of its height and lifts its bar by 50 degrees; the points in the
    /// second frame are others.
    #[test]
    fn a_turned_figure_with_a_lifted_bar_is_followed() {
        let angle = 50_f64.to_radians();
        let by = RigidMotion { rotation: DQuat::from_rotation_y(0.5), shift: DVec3::new(0.3, 0.1, -0.2) };
        let source = figure(300, 0.0, 1);
        let expected = moved(&figure(300, angle, 1), by);
        let target = moved(&figure(310, angle, 2), by);
        let motions = register(&source, &target);
        let errors = |bar: bool| {
            let is_part = move |i: &usize| i.is_multiple_of(4) == bar;
            let error = |i: usize| motions[i].apply(source.positions[i]).distance(expected.positions[i]);
            let errors: Vec<f64> = (0..300).filter(is_part).map(error).collect();
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        let went = |i: usize| source.positions[i].distance(expected.positions[i]);
        let went = (0..300).map(went).sum::<f64>() / 300.0;
        assert!(went > 0.4, "{went}");
        let [body, bar] = [errors(false), errors(true)];
        assert!(body < 0.04 && bar < 0.1, "{body} {bar}");
    }

    /// A capture may be in millimetres or in kilometres, and anywhere.
    #[test]
    fn the_unit_and_the_origin_do_not_matter() {
        let [source, target] = [(0.0, 1), (0.4, 2)].map(|(angle, seed)| figure(80, angle, seed));
        let expected = register(&source, &target);
        for scale in [1e-6, 1e6] {
            let place = |point: &DVec3| scale * (*point + DVec3::new(30.0, -20.0, 10.0));
            let placed = |points: &SurfacePoints| SurfacePoints {
                positions: points.positions.iter().map(place).collect(),
                ..points.clone()
            };
            let motions = register(&placed(&source), &placed(&target));
            for ((point, motion), expected) in source.positions.iter().zip(&motions).zip(&expected) {
                let difference = motion.apply(place(point)) - place(&expected.apply(*point));
                assert!(difference.length() < 1e-6 * scale, "{scale:e}: {difference}");
            }
        }
    }

    /// The rotation about a line of points is not determined; they still follow it.
    #[test]
    fn points_on_a_line_follow_it() {
        let line = |angle: f64| {
            let direction = DQuat::from_rotation_z(angle) * DVec3::X;
            let positions: Vec<DVec3> = (0..60).map(|i| f64::from(i) / 59.0 * direction).collect();
            let colors = (0..60).map(|i| DVec3::splat(f64::from(i) / 59.0)).collect();
            SurfacePoints { positions, colors }
        };
        let (source, target) = (line(0.0), line(0.6));
        for (i, motion) in register(&source, &target).iter().enumerate() {
            let away = motion.apply(source.positions[i]).distance(target.positions[i]);
            assert!(motion.rotation.is_finite() && away < 0.05, "{i}: {away}");
        }
    }

    #[test]
    fn points_of_no_extent_do_not_move() {
        let points = figure(40, 0.0, 1);
        let one = SurfacePoints { positions: vec![DVec3::X; 3], colors: vec![DVec3::ONE; 3] };
        for (source, target) in [(&one, &points), (&points, &SurfacePoints::default())] {
            assert!(register(source, target).iter().all(|motion| *motion == RigidMotion::NONE));
        }
        assert!(register(&SurfacePoints::default(), &points).is_empty());
    }

    #[test]
    fn the_rotation_of_a_matrix_is_found_from_afar() {
        let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 2.8);
        let stretch = DMat3::from_diagonal(DVec3::new(1.0, 3.0, 0.2));
        let matrix = DMat3::from_quat(rotation) * stretch;
        let mut found = DQuat::IDENTITY;
        for _ in 0..5 {
            found = extract_rotation(matrix, found);
        }
        assert!(found.dot(rotation).abs() > 1.0 - 1e-6, "{found} {rotation}");
        assert_eq!(extract_rotation(DMat3::ZERO, rotation), rotation);
    }
}
