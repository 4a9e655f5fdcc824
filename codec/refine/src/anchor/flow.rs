//! First velocities: how the anchor of a frame moves to those of its neighbours in time.
//!
//! Some Gaussians of a frame look for the nearest one, in place and colour, in the frame before and in
//! the one after; every Gaussian takes the median velocity of those around it. Nearest neighbours
//! understate what moves along itself, but say where all of a limb goes.

use glam::Vec3;
use rayon::prelude::*;

use super::ground::SH_CONSTANT;
use crate::fit::Parameters;

/// Most Gaussians of a frame that look for a neighbour.
const SEEKERS: usize = 2048;

/// How many of them a velocity is the median of.
const AROUND: usize = 8;

/// Distance, by the size of the subject, that is as far as from black to white.
const COLOR: f32 = 0.5;

/// Distance, by the size of the subject, beyond which a neighbour is another part.
const FAR: f32 = 0.25;

/// A Gaussian as a neighbour is looked for.
#[derive(Clone, Copy)]
struct Point {
    place: Vec3,
    color: Vec3,
}

/// Sets the velocities of frames in the order of time.
pub(super) fn set_velocities(frames: &mut [(usize, Parameters<f32>)]) {
    let points: Vec<Vec<Point>> = frames.iter().map(|(_, gaussians)| points(gaussians)).collect();
    for i in 0..frames.len() {
        let size = size(&points[i]);
        let neighbors: Vec<(&[Point], f32)> = [i.checked_sub(1), Some(i + 1)]
            .into_iter()
            .flatten()
            .filter(|other| points.get(*other).is_some_and(|points| !points.is_empty()))
            .map(|other| (&points[other][..], frames[other].0 as f32 - frames[i].0 as f32))
            .collect();
        let gaussians = &mut frames[i].1;
        let order = usize::from(gaussians.motion_order);
        if order == 0 || neighbors.is_empty() || gaussians.is_empty() || size <= 0.0 {
            continue;
        }
        let every = points[i].len().div_ceil(SEEKERS);
        let seekers: Vec<(Vec3, Vec3)> = points[i]
            .par_iter()
            .step_by(every)
            .map(|seeker| (seeker.place, velocity(seeker, &neighbors, size)))
            .collect();
        gaussians
            .motion
            .par_chunks_mut(order)
            .zip(&points[i])
            .for_each(|(motion, point)| motion[0] = median_around(point.place, &seekers).to_array());
    }
}

fn points(gaussians: &Parameters<f32>) -> Vec<Point> {
    let per_row = codec::sh_coefficients(gaussians.sh_degree);
    let dc = gaussians.sh.iter().step_by(per_row);
    let point = |(place, dc): (&[f32; 3], &[f32; 3])| Point {
        place: Vec3::from_array(*place),
        color: SH_CONSTANT as f32 * Vec3::from_array(*dc),
    };
    gaussians.centers.iter().zip(dc).map(point).collect()
}

/// Root mean square distance from the middle.
fn size(points: &[Point]) -> f32 {
    let n = points.len().max(1) as f32;
    let middle = points.iter().map(|point| point.place).sum::<Vec3>() / n;
    (points.iter().map(|point| point.place.distance_squared(middle)).sum::<f32>() / n).sqrt()
}

/// Mean velocity towards the nearest points of the frames that far away in time; those that have
/// none near do not count.
fn velocity(seeker: &Point, neighbors: &[(&[Point], f32)], size: f32) -> Vec3 {
    let weight = (COLOR * size).powi(2);
    let (mut sum, mut count) = (Vec3::ZERO, 0.0);
    for (points, time) in neighbors {
        let mut nearest = (f32::INFINITY, Vec3::ZERO);
        for point in *points {
            let apart = point.place.distance_squared(seeker.place)
                + weight * point.color.distance_squared(seeker.color);
            if apart < nearest.0 {
                nearest = (apart, point.place);
            }
        }
        if nearest.0 < (FAR * size).powi(2) {
            sum += (nearest.1 - seeker.place) / *time;
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { Vec3::ZERO }
}

/// Medians, axis by axis, of the velocities of the nearest seekers.
fn median_around(place: Vec3, seekers: &[(Vec3, Vec3)]) -> Vec3 {
    // The nearest so far, the farthest of them last.
    let mut near = [(f32::INFINITY, Vec3::ZERO); AROUND];
    let mut found = 0;
    for (at, velocity) in seekers {
        let apart = at.distance_squared(place);
        if apart >= near[AROUND - 1].0 {
            continue;
        }
        let mut slot = AROUND - 1;
        while slot > 0 && near[slot - 1].0 > apart {
            near[slot] = near[slot - 1];
            slot -= 1;
        }
        near[slot] = (apart, *velocity);
        found = (found + 1).min(AROUND);
    }
    let median = |axis: usize| {
        let mut values: Vec<f32> = near[..found].iter().map(|(_, velocity)| velocity[axis]).collect();
        values.sort_by(f32::total_cmp);
        0.5 * (values[(found - 1) / 2] + values[found / 2])
    };
    Vec3::new(median(0), median(1), median(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of coloured points at `middle`.
    fn ball(middle: Vec3, seed: u64) -> Parameters<f32> {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut ball = Parameters { motion_order: 2, ..Parameters::default() };
        while ball.len() < 3000 {
            let mut unit = || 2.0 * random.f32() - 1.0;
            let place = Vec3::new(unit(), unit(), unit());
            if place.length() < 1.0 {
                ball.centers.push((middle + place).to_array());
                // Colour from -1.7 to 1.7, as coefficients go, across the ball.
                ball.sh.push((1.7 * place).to_array());
                ball.motion.extend([[0.0; 3]; 2]);
            }
        }
        ball
    }

    #[test]
    fn a_ball_moves_as_it_does() {
        // A quarter of the points' distance per frame.
        let velocity = Vec3::new(0.015, -0.01, 0.0);
        let mut frames: Vec<(usize, Parameters<f32>)> =
            [0, 2, 4].map(|t| (t, ball(t as f32 * velocity, 0))).to_vec();
        set_velocities(&mut frames);
        for (t, ball) in &frames {
            let mean = ball.motion.iter().step_by(2).map(|v| Vec3::from_array(*v)).sum::<Vec3>() / 3000.0;
            assert!((mean - velocity).length() < 0.003, "{mean} in frame {t}");
            assert!(ball.motion.iter().skip(1).step_by(2).all(|v| *v == [0.0; 3]));
        }
    }

    #[test]
    fn alone_or_next_to_something_else_nothing_moves() {
        let mut alone =
            vec![(0, ball(Vec3::ZERO, 0)), (1, Parameters { motion_order: 2, ..Default::default() })];
        set_velocities(&mut alone);
        let mut far = vec![(0, ball(Vec3::ZERO, 0)), (1, ball(Vec3::splat(9.0), 0))];
        set_velocities(&mut far);
        assert!(alone[0].1.motion.iter().chain(&far[0].1.motion).all(|v| *v == [0.0; 3]));
    }
}
