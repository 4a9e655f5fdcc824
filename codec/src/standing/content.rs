//! [`Content`]: what people look at in a field, without walls, sky, backdrop, floor and strays.
//!
//! What a disc counts is its opacity times its area, at most the area that a fifth of them do not have: walls and a sky are
//! made of larger ones than what stands before them, dust of smaller ones. The content is the ball with the largest weight
//! over radius^0.75, among balls with a fifth of all weight. With an exponent of 1, half of a stick would count as much as the
//! whole stick. With a lower one, a room would count more than an object in it that has half of the weight in a tenth of the
//! size. Balls are found from seeds by mean shift: the centre of mass of a ball is the centre of the next. Further balls of
//! about that size and score near it belong to the content: two people, or one who walks.

use super::discs::{Disc, Discs};
use crate::camera::{dot, norm, sub};

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

/// Balls of the content, at most.
const BALLS_MAX: usize = 8;

/// A further ball has at least this share of the best score, ...
const FURTHER_SCORE_MIN: f64 = 0.4;

/// ... at most so many times the radius of the best one, ...
const FURTHER_RADIUS_MAX: f64 = 2.0;

/// ... and its centre is at most so many radii of that away.
const FURTHER_DISTANCE_MAX: f64 = 6.0;

/// Share of the weight beyond either side of the box of the content, along each axis.
const STRAYS: f64 = 0.02;

/// Distance from the centre up to which things belong to the content, in radii: an arm that reaches out of the ball.
pub(super) const EXTENT: f64 = 2.0;

/// Largest gap between things one above the other that belong together, in radii: legs below a body, feet on a floor.
const GAP_MAX: f64 = 0.25;

/// Nothing but content is there where all but strays lie within so many radii, such as a body with thin limbs.
const LONE_EXTENT: f64 = 4.0;

/// What people look at.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Content {
    /// The balls that hold most of it, the best one first. Never empty.
    pub(super) balls: Vec<Ball>,
    /// Lowest and highest points of what stands above and below the centres of the balls without a gap, in source units.
    pub(super) ends: Vec<[f64; 3]>,
    /// Corners `[min, max]` of the box around it, without strays, in source units.
    pub(super) bounds: [[f64; 3]; 2],
}

/// A point of the content's mass.
#[derive(Clone)]
struct Mass {
    point: [f64; 3],
    weight: f64,
}

/// A ball around a centre, with its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    /// In source units.
    pub(super) center: [f64; 3],
    /// In source units, above 0.
    pub(super) radius: f64,
    pub(super) score: f64,
}

impl Content {
    /// The content of the field of `discs`, and the box of all of the field where there may be nothing but content. A ball
    /// of radius 1 at the origin without discs. `up` is a unit vector.
    pub(super) fn find(discs: &Discs, up: [f64; 3]) -> (Content, Option<[[f64; 3]; 2]>) {
        let (masses, grain) = masses(discs);
        let total: f64 = masses.iter().map(|mass| mass.weight).sum();
        if total <= 0.0 {
            let ball = Ball { center: [0.0; 3], radius: 1.0, score: 0.0 };
            return (Content { balls: vec![ball], ends: Vec::new(), bounds: [[-1.0; 3], [1.0; 3]] }, None);
        }
        let found: Vec<Ball> =
            seeds(&masses, total).into_iter().map(|seed| shifted(seed, &masses, total, grain)).collect();
        let balls = group(&found);
        let ends = balls.iter().flat_map(|ball| ball.ends(&masses, up)).collect();
        let content = Content { balls, ends, bounds: [[0.0; 3]; 2] };
        let beyond = |mass: &Mass| (content.radii_to(mass.point), mass.weight);
        let is_alone = weighted_quantile(masses.iter().map(beyond), 1.0 - STRAYS) <= LONE_EXTENT;
        let whole = is_alone.then(|| box_of(&content.parts(masses.clone(), true)));
        let bounds = with_points(box_of(&content.parts(masses, false)), content.ends.iter().copied());
        (Content { bounds, ..content }, whole)
    }

    /// Those of `masses` that belong to the content: all but strays where it `is_alone`.
    fn parts(&self, mut masses: Vec<Mass>, is_alone: bool) -> Vec<Mass> {
        let extent = if is_alone { LONE_EXTENT } else { EXTENT };
        masses.retain(|mass| self.radii_to(mass.point) <= extent);
        if is_alone {
            // Thin limbs weigh little, so each row counts alike.
            masses.iter_mut().for_each(|mass| mass.weight = 1.0);
        }
        masses
    }

    /// Distance of `point` from the centre of a ball in radii of that ball, the least over the balls.
    pub(super) fn radii_to(&self, point: [f64; 3]) -> f64 {
        self.balls
            .iter()
            .map(|ball| norm(sub(point, ball.center)) / ball.radius)
            .fold(f64::INFINITY, f64::min)
    }

    /// Radius of the smallest ball around the mean of the centres that holds all balls, in source units.
    pub(super) fn radius(&self) -> f64 {
        let share = 1.0 / self.balls.len() as f64;
        let center: [f64; 3] =
            std::array::from_fn(|axis| self.balls.iter().map(|ball| share * ball.center[axis]).sum());
        self.balls.iter().map(|ball| norm(sub(ball.center, center)) + ball.radius).fold(0.0, f64::max)
    }
}

impl Ball {
    /// Lowest and highest points along `up`, a unit vector, of what stands above and below the centre without a gap.
    fn ends(&self, masses: &[Mass], up: [f64; 3]) -> [[f64; 3]; 2] {
        // In radii.
        let mut heights: Vec<f64> = masses
            .iter()
            .filter_map(|mass| {
                let from_center = sub(mass.point, self.center).map(|x| x / self.radius);
                let height = dot(from_center, up);
                let aside = norm(std::array::from_fn(|axis| from_center[axis] - height * up[axis]));
                (aside <= 1.0 && height.abs() <= LONE_EXTENT).then_some(height)
            })
            .collect();
        heights.sort_by(f64::total_cmp);
        let above = heights.partition_point(|height| *height < 0.0);
        let low = end_of(heights[..above].iter().rev());
        let high = end_of(heights[above..].iter());
        [low, high]
            .map(|height| std::array::from_fn(|axis| self.center[axis] + height * self.radius * up[axis]))
    }
}

/// The last of `heights`, from 0 on, before a gap.
fn end_of<'a>(heights: impl Iterator<Item = &'a f64>) -> f64 {
    let mut end = 0.0;
    for height in heights {
        if (height - end).abs() > GAP_MAX {
            break;
        }
        end = *height;
    }
    end
}

/// The ball that mean shift finds from `seed`.
fn shifted(seed: [f64; 3], masses: &[Mass], total: f64, grain: f64) -> Ball {
    let mut ball = best_ball(seed, masses, total, grain);
    for _ in 0..SHIFTS {
        let next = best_ball(center_of_mass(&ball, masses), masses, total, grain);
        if next.score <= ball.score {
            break;
        }
        ball = next;
    }
    ball
}

/// The best ball, and those that belong to it; from the best one on.
fn group(found: &[Ball]) -> Vec<Ball> {
    let mut balls: Vec<Ball> = found.to_vec();
    // Stable: the first of equals.
    balls.sort_by(|a, b| b.score.total_cmp(&a.score));
    let best = balls[0];
    let mut group = vec![best];
    for ball in balls {
        let apart = |other: &Ball| norm(sub(ball.center, other.center));
        let is_like_it = ball.score >= FURTHER_SCORE_MIN * best.score
            && ball.radius <= FURTHER_RADIUS_MAX * best.radius
            && apart(&best) <= FURTHER_DISTANCE_MAX * best.radius;
        if is_like_it && group.len() < BALLS_MAX && group.iter().all(|other| apart(other) > other.radius) {
            group.push(ball);
        }
    }
    group
}

/// Corners `[min, max]` along `axes` of the box around `content`, which may be alone, without strays; without discs, of the
/// box around its bounds.
pub(super) fn bounds_along(
    axes: [[f64; 3]; 3],
    content: &Content,
    discs: &Discs,
    is_alone: bool,
) -> [[f64; 3]; 2] {
    let along = |point: [f64; 3]| axes.map(|axis| dot(axis, point));
    let mut masses = content.parts(masses(discs).0, is_alone);
    if masses.is_empty() {
        let [low, high] = content.bounds;
        let corner =
            |i: usize| along([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low } else { high }[axis]));
        return with_points([corner(0); 2], (1..8).map(corner));
    }
    masses.iter_mut().for_each(|mass| mass.point = along(mass.point));
    let ends = if is_alone { &[][..] } else { &content.ends };
    with_points(box_of(&masses), ends.iter().map(|end| along(*end)))
}

/// The smallest box around a box and `points`.
fn with_points(bounds: [[f64; 3]; 2], points: impl Iterator<Item = [f64; 3]>) -> [[f64; 3]; 2] {
    points.fold(bounds, |[low, high], point| {
        let outer = |corner: [f64; 3], extreme: fn(f64, f64) -> f64| {
            std::array::from_fn(|axis| extreme(corner[axis], point[axis]))
        };
        [outer(low, f64::min), outer(high, f64::max)]
    })
}

/// The masses of the discs of fields, and the size of a point.
fn masses(discs: &Discs) -> (Vec<Mass>, f64) {
    let discs: Vec<&Disc> =
        discs.instants.iter().flatten().filter(|disc| disc.row < discs.field_rows).collect();
    let discs: Vec<&Disc> = discs.iter().step_by(discs.len().div_ceil(POINTS).max(1)).copied().collect();
    let grain = weighted_quantile(discs.iter().map(|disc| (disc.radius, disc.opacity)), SHARE_MIN);
    let mass = |disc: &&Disc| {
        // The square of the radius alone may be out of range.
        let weight = disc.opacity * (disc.radius / grain).min(1.0).powi(2);
        Mass { point: disc.center, weight }
    };
    (discs.iter().map(mass).collect(), grain)
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

/// Corners of the box around `masses`, without strays.
fn box_of(masses: &[Mass]) -> [[f64; 3]; 2] {
    [STRAYS, 1.0 - STRAYS].map(|share| {
        std::array::from_fn(|axis| {
            weighted_quantile(masses.iter().map(|mass| (mass.point[axis], mass.weight)), share)
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
