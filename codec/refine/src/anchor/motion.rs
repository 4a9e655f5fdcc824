//! [`start_motion`]: initial trajectories of the Gaussians, from how the surface moves between neighbouring frames.
//!
//! A fit moves a Gaussian along the gradient of its pictures, which leads it only about as far as it is large. Where
//! frames move by more than that, it stays, and the picture between two photographs shows a blend of both. So every
//! frame's surface is registered to the next and to the previous one, and each Gaussian starts on a parabola that follows
//! its three positions.

use std::ops::Range;

use codec::{SH_C0, sh_coefficients};
use glam::DVec3;
use rayon::prelude::*;

use super::registration::{RigidMotion, SurfacePoints, register};
use crate::fit::Parameters;

/// Most points of a frame that are registered; the other Gaussians move with the nearest one.
const POINTS: usize = 300;

/// The Gaussians of one frame.
pub(super) struct FrameRows {
    /// Time of the frame in intervals.
    pub(super) time: f64,
    pub(super) rows: Range<usize>,
}

/// Mean velocity of a Gaussian to or from a neighbouring frame, per interval, and the time between the two frames.
type Leg = (DVec3, f64);

/// Starts the motion of `gaussians`; `frames` has the rows of each frame, in ascending order of time. The first and the
/// last frame have a neighbour on one side only, and start with constant velocities.
pub(super) fn start_motion(gaussians: &mut Parameters<f32>, frames: &[FrameRows]) {
    let order = usize::from(gaussians.motion_order);
    if order == 0 {
        return;
    }
    let points: Vec<SurfacePoints> = frames.iter().map(|frame| sample(gaussians, &frame.rows)).collect();
    let coefficients: Vec<Vec<[DVec3; 2]>> = (0..frames.len())
        .into_par_iter()
        .map(|i| {
            let [before, after] = [i.checked_sub(1), Some(i + 1).filter(|after| *after < frames.len())]
                .map(|to| to.map(|to| (register(&points[i], &points[to]), frames[to].time - frames[i].time)));
            let coefficients = |row: usize| {
                let center = center(gaussians, row);
                let nearest = nearest(&points[i].positions, center);
                let leg = |to: &Option<(Vec<RigidMotion>, f64)>| -> Option<Leg> {
                    let (motions, intervals) = to.as_ref()?;
                    Some(((motions[nearest].apply(center) - center) / *intervals, intervals.abs()))
                };
                parabola(leg(&before), leg(&after))
            };
            frames[i].rows.clone().map(coefficients).collect()
        })
        .collect();
    for (frame, coefficients) in frames.iter().zip(coefficients) {
        for (row, coefficients) in frame.rows.clone().zip(coefficients) {
            for (motion, coefficient) in
                gaussians.motion[row * order..].iter_mut().zip(coefficients).take(order)
            {
                *motion = coefficient.to_array().map(|x| x as f32);
            }
        }
    }
}

/// At most [`POINTS`] of the rows, evenly, and only of the most opaque ones: the others lie behind the surface.
fn sample(gaussians: &Parameters<f32>, rows: &Range<usize>) -> SurfacePoints {
    let most = gaussians.logits[rows.clone()].iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let on_surface: Vec<usize> = rows.clone().filter(|row| gaussians.logits[*row] == most).collect();
    let count = on_surface.len().min(POINTS);
    let coefficients = sh_coefficients(gaussians.sh_degree);
    let color = |row: usize| gaussians.sh[row * coefficients].map(|first| SH_C0 * f64::from(first) + 0.5);
    let point = |i: usize| {
        let row = on_surface[i * on_surface.len() / count];
        (center(gaussians, row), DVec3::from_array(color(row)))
    };
    let (positions, colors) = (0..count).map(point).unzip();
    SurfacePoints { positions, colors }
}

fn center(gaussians: &Parameters<f32>, row: usize) -> DVec3 {
    DVec3::from_array(gaussians.centers[row].map(f64::from))
}

/// Index of the point nearest to a position; 0 without points.
fn nearest(points: &[DVec3], position: DVec3) -> usize {
    let distances = points.iter().map(|point| point.distance_squared(position)).enumerate();
    distances.min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(i, _)| i)
}

/// The coefficients `c1` and `c2` of a trajectory.
///
/// Its curvature is the curvature of the parabola through the three positions. Its velocity is not the parabola's: a
/// parabola overshoots where a motion starts or stops at once. As in monotone cubic interpolation (Fritsch and Butland,
/// "A method for constructing local monotone piecewise cubic interpolants", 1984) the slower side counts more, and a
/// motion that turns back rests for an instant.
fn parabola(before: Option<Leg>, after: Option<Leg>) -> [DVec3; 2] {
    let (Some((v0, h0)), Some((v1, h1))) = (before, after) else {
        return [before.or(after).map_or(DVec3::ZERO, |(velocity, _)| velocity), DVec3::ZERO];
    };
    let [speed0, speed1] = [v0.length(), v1.length()];
    let velocity =
        if v0.dot(v1) > 0.0 { (v0 * speed1 + v1 * speed0) / (speed0 + speed1) } else { DVec3::ZERO };
    [velocity, (v1 - v0) / (h0 + h1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of points on a lattice whose colours differ by corner, at three instants.
    fn frames(positions: [DVec3; 3], motion_order: u8) -> (Parameters<f32>, Vec<FrameRows>) {
        let mut gaussians = Parameters { motion_order, ..Parameters::default() };
        let mut frames = Vec::new();
        for (time, position) in [0.0, 1.0, 3.0].into_iter().zip(positions) {
            let first = gaussians.len();
            for i in 0..125 {
                let at = DVec3::new(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25));
                gaussians.centers.push((0.1 * at + position).to_array().map(|x| x as f32));
                gaussians.sh.push((0.5 * at - 1.0).to_array().map(|x| x as f32));
                gaussians.logits.push(0.0);
                gaussians.tau.push(time as f32);
            }
            frames.push(FrameRows { time, rows: first..gaussians.len() });
        }
        gaussians.motion = vec![[0.0; 3]; gaussians.len() * usize::from(motion_order)];
        (gaussians, frames)
    }

    fn is_near(found: [f32; 3], expected: DVec3) -> bool {
        DVec3::from_array(found.map(f64::from)).distance(expected) < 0.01
    }

    /// The cube goes 0.3 in the first interval and 0.6 in the two that follow, 0.3 per interval, then 0.1 aside.
    #[test]
    fn gaussians_start_on_the_motion_of_the_surface() {
        let path = [DVec3::ZERO, DVec3::new(0.3, 0.0, 0.0), DVec3::new(0.9, 0.2, 0.0)];
        let (mut gaussians, frames) = frames(path, 3);
        start_motion(&mut gaussians, &frames);
        for (i, row) in (0..125).chain(125..250).chain(250..375).enumerate() {
            let [c1, c2, c3] = std::array::from_fn(|power| gaussians.motion[3 * row + power]);
            let [v0, v1] = [DVec3::new(0.3, 0.0, 0.0), DVec3::new(0.3, 0.1, 0.0)];
            let (expected1, expected2) = match i / 125 {
                0 => (v0, DVec3::ZERO),
                1 => ((v0 * v1.length() + v1 * v0.length()) / (v0.length() + v1.length()), (v1 - v0) / 3.0),
                _ => (v1, DVec3::ZERO),
            };
            assert!(is_near(c1, expected1) && is_near(c2, expected2), "{row}: {c1:?} {c2:?}");
            assert_eq!(c3, [0.0; 3]);
        }
    }

    #[test]
    fn trajectories_of_lower_order_have_what_they_can() {
        let path = [0.0, 0.3, 0.5].map(|x| DVec3::new(x, 0.0, 0.0));
        let (mut linear, rows) = frames(path, 1);
        start_motion(&mut linear, &rows);
        assert!(is_near(linear.motion[0], path[1]) && linear.motion.len() == linear.len());
        let (mut fixed, rows) = frames(path, 0);
        start_motion(&mut fixed, &rows);
        assert!(fixed.motion.is_empty());
        let (mut one, rows) = frames(path, 3);
        start_motion(&mut one, &rows[..1]);
        assert!(one.motion.iter().all(|c| *c == [0.0; 3]), "a frame without neighbours");
    }

    #[test]
    fn a_motion_that_stops_does_not_overshoot() {
        let fast = Some((DVec3::X, 1.0));
        let [velocity, curvature] = parabola(fast, Some((DVec3::ZERO, 1.0)));
        assert_eq!((velocity, curvature), (DVec3::ZERO, -0.5 * DVec3::X));
        let [velocity, curvature] = parabola(fast, Some((-DVec3::X, 1.0)));
        assert_eq!((velocity, curvature), (DVec3::ZERO, -DVec3::X));
        assert_eq!(parabola(fast, Some((DVec3::X, 2.0))), [DVec3::X, DVec3::ZERO]);
        assert_eq!(parabola(None, None), [DVec3::ZERO; 2]);
    }
}
