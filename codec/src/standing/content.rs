//! [`Content`]: what people look at in a field, without walls, sky, backdrop, floor and strays.
//!
//! What a disc counts is its opacity times its area, at most the area that a fifth of them do not have: walls and a sky are
//! made of larger ones than what stands before them, dust of smaller ones. The content is the ball with the largest weight
//! over radius^0.75, among balls with a fifth of all weight. The exponent is below 1, with which a stick counts as much as
//! any half of it, and so high that half of the weight in a tenth of the size wins over the whole. Balls are found from
//! seeds by mean shift: the centre of mass of a ball is the centre of the next.

use super::discs::{Disc, Discs};
use crate::camera::{norm, sub};

/// Exponent of the radius in the score of a ball.
const CONCENTRATION: f64 = 0.75;

/// Least share of the weight that the content has.
const SHARE_MIN: f64 = 0.2;

/// Discs that are looked at, at most.
const POINTS: usize = 4096;

/// Number of discs, evenly over the weight, from which a ball is sought.
const SEEDS: usize = 24;

/// Mean shifts of a ball, at most.
const SHIFTS: usize = 12;

/// Share of the weight beyond either side of the box of the content, along each axis.
const STRAYS: f64 = 0.02;

/// Distance from the centre up to which things belong to the content, in radii: an arm that reaches out of the ball.
pub(super) const EXTENT: f64 = 2.0;

/// Nothing but content is there where all but strays lie within so many radii, such as a body with a thin neck.
const LONE_EXTENT: f64 = 4.0;

/// What people look at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Content {
    /// Centre of the ball that holds most of it, in source units.
    pub(super) center: [f64; 3],
    /// Radius of the ball in source units, above 0.
    pub(super) radius: f64,
    /// Corners `[min, max]` of the box around it, without strays, in source units.
    pub(super) bounds: [[f64; 3]; 2],
}

/// A point of the content's mass.
struct Mass {
    point: [f64; 3],
    weight: f64,
}

/// A ball around a centre, with its score.
#[derive(Clone, Copy)]
struct Ball {
    center: [f64; 3],
    radius: f64,
    score: f64,
}

impl Content {
    /// The content of the field of `discs`, and the box of all of the field where there may be nothing but content. A ball
    /// of radius 1 at the origin without discs.
    pub(super) fn of(discs: &Discs) -> (Content, Option<[[f64; 3]; 2]>) {
        let discs: Vec<&Disc> =
            discs.instants.iter().flatten().filter(|disc| disc.row < discs.field_rows).collect();
        let discs: Vec<&Disc> = discs.iter().step_by(discs.len().div_ceil(POINTS).max(1)).copied().collect();
        let grain = weighted_quantile(discs.iter().map(|disc| (disc.radius, disc.opacity)), SHARE_MIN);
        let mass = |disc: &&Disc| {
            // The square of the radius alone may be out of range.
            let weight = disc.opacity * (disc.radius / grain).min(1.0).powi(2);
            Mass { point: disc.center, weight }
        };
        let masses: Vec<Mass> = discs.iter().map(mass).collect();
        let total: f64 = masses.iter().map(|mass| mass.weight).sum();
        if total <= 0.0 {
            return (Content { center: [0.0; 3], radius: 1.0, bounds: [[-1.0; 3], [1.0; 3]] }, None);
        }
        let mut best: Option<Ball> = None;
        for seed in seeds(&masses, total) {
            let mut ball = best_ball(seed, &masses, total, grain);
            for _ in 0..SHIFTS {
                let shifted = best_ball(center_of_mass(&ball, &masses), &masses, total, grain);
                if shifted.score <= ball.score {
                    break;
                }
                ball = shifted;
            }
            if best.is_none_or(|best| ball.score > best.score) {
                best = Some(ball);
            }
        }
        let Ball { center, radius, .. } =
            best.unwrap_or(Ball { center: masses[0].point, radius: grain, score: 0.0 });
        let distances = masses.iter().map(|mass| (norm(sub(mass.point, center)), mass.weight));
        let is_alone = weighted_quantile(distances, 1.0 - STRAYS) <= LONE_EXTENT * radius;
        let bounds = box_within(&masses, center, EXTENT * radius);
        let whole = is_alone.then(|| box_within(&masses, center, f64::INFINITY));
        (Content { center, radius, bounds }, whole)
    }
}

/// Points evenly over the weight.
fn seeds(masses: &[Mass], total: f64) -> Vec<[f64; 3]> {
    let mut seeds = Vec::with_capacity(SEEDS);
    let mut sum = 0.0;
    for mass in masses {
        sum += mass.weight;
        while seeds.len() < SEEDS && sum >= (seeds.len() as f64 + 0.5) / SEEDS as f64 * total {
            seeds.push(mass.point);
        }
    }
    seeds
}

/// The ball around `center` with the highest score. `grain` is the size of a point.
fn best_ball(center: [f64; 3], masses: &[Mass], total: f64, grain: f64) -> Ball {
    let mut distances: Vec<(f64, f64)> =
        masses.iter().map(|mass| (norm(sub(mass.point, center)), mass.weight)).collect();
    // Stable, so that equal distances add their weights in the order of the rows on any machine.
    distances.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best = Ball { center, radius: grain, score: 0.0 };
    let mut weight = 0.0;
    for (distance, more) in distances {
        weight += more;
        let radius = distance.max(grain);
        // In units of the grain, so that no power leaves the range.
        let score = weight / libm::pow(radius / grain, CONCENTRATION);
        if weight >= SHARE_MIN * total && score > best.score {
            best = Ball { center, radius, score };
        }
    }
    best
}

fn center_of_mass(ball: &Ball, masses: &[Mass]) -> [f64; 3] {
    let (mut offset, mut total) = ([0.0; 3], 0.0);
    for Mass { point, weight } in masses {
        let from_center = sub(*point, ball.center);
        if norm(from_center) <= ball.radius {
            (0..3).for_each(|axis| offset[axis] += weight * from_center[axis]);
            total += weight;
        }
    }
    if total > 0.0 {
        std::array::from_fn(|axis| ball.center[axis] + offset[axis] / total)
    } else {
        ball.center
    }
}

/// Corners of the box around what lies within `extent` of `center`, without strays.
fn box_within(masses: &[Mass], center: [f64; 3], extent: f64) -> [[f64; 3]; 2] {
    let within: Vec<&Mass> = masses.iter().filter(|mass| norm(sub(mass.point, center)) <= extent).collect();
    [STRAYS, 1.0 - STRAYS].map(|share| {
        std::array::from_fn(|axis| {
            weighted_quantile(within.iter().map(|mass| (mass.point[axis], mass.weight)), share)
        })
    })
}

/// The value up to which `share` of the weight lies; 1 without values.
fn weighted_quantile(values: impl Iterator<Item = (f64, f64)>, share: f64) -> f64 {
    let mut values: Vec<(f64, f64)> = values.collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let limit = share * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let reaches = |(_, weight): &&(f64, f64)| {
        sum += weight;
        sum >= limit
    };
    values.iter().find(reaches).or(values.last()).map_or(1.0, |(value, _)| *value)
}
