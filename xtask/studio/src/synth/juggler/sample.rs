//! Points spread evenly over surfaces.

use std::collections::HashMap;
use std::f64::consts::PI;

use glam::{DVec3, IVec3, dvec3};

use super::sdf;

/// Darts per cell of one spacing.
const DARTS: usize = 5;

/// Smallest distance of two darts, relative to the spacing: a random packing is looser than the even
/// one that relaxation reaches.
const PACKING: f64 = 0.78;

/// Relaxation steps.
const ROUNDS: usize = 8;

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) point: DVec3,
    /// Unit normal, outwards.
    pub(super) normal: DVec3,
    /// Approximate distance of the neighbours.
    pub(super) spacing: f64,
}

/// Evenly spread directions: a Fibonacci lattice.
pub(super) fn fibonacci_sphere(count: u32) -> impl Iterator<Item = DVec3> {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let r = (1.0 - z * z).sqrt();
        let angle = golden * f64::from(i);
        dvec3(r * angle.cos(), r * angle.sin(), z)
    })
}

/// Covers the part of the zero set of `distance` that is `is_covered` with points about `spacing`
/// apart. That part lies in the box from `low` to `high`, where `near` is small.
///
/// Poisson-disc sampling by dart throwing, followed by relaxation.
pub(super) fn cover(
    distance: &dyn Fn(DVec3) -> f64,
    [low, high]: [DVec3; 2],
    near: &dyn Fn(DVec3) -> f64,
    is_covered: &dyn Fn(DVec3) -> bool,
    spacing: f64,
) -> Vec<Sample> {
    let mut random = fastrand::Rng::with_seed(1);
    let mut darts = Vec::new();
    let steps = ((high - low) / spacing).ceil().as_ivec3();
    for x in 0..steps.x {
        for y in 0..steps.y {
            for z in 0..steps.z {
                let corner = low + IVec3::new(x, y, z).as_dvec3() * spacing;
                let center = corner + 0.5 * spacing;
                if near(center) > 2.0 * spacing || distance(center).abs() > spacing {
                    continue;
                }
                for _ in 0..DARTS {
                    let dart = corner + spacing * dvec3(random.f64(), random.f64(), random.f64());
                    darts.extend(onto(distance, dart));
                }
            }
        }
    }
    random.shuffle(&mut darts);
    let mut grid = Grid::new(spacing);
    darts.retain(|&dart| {
        let free = grid.near(dart).all(|p| (p - dart).length() >= PACKING * spacing);
        if free {
            grid.insert(dart);
        }
        free
    });
    let cell = 1.3 * spacing;
    for _ in 0..ROUNDS {
        let mut grid = Grid::new(cell);
        darts.iter().for_each(|&dart| grid.insert(dart));
        for dart in &mut darts {
            let away = grid.near(*dart).map(|p| *dart - p).filter(|d| (1e-9..cell).contains(&d.length()));
            let push: DVec3 = away.map(|d| d.normalize() * (1.0 - d.length() / cell)).sum();
            if let Some(moved) = onto(distance, *dart + push * (0.3 * spacing)) {
                *dart = moved;
            }
        }
    }
    darts.retain(|&dart| is_covered(dart));
    darts.into_iter().map(|point| Sample { point, normal: sdf::normal(distance, point), spacing }).collect()
}

/// Projects `p` onto the surface along the gradient.
fn onto(distance: &dyn Fn(DVec3) -> f64, mut p: DVec3) -> Option<DVec3> {
    for _ in 0..6 {
        let d = distance(p);
        if d.abs() < 1e-4 {
            return Some(p);
        }
        p -= sdf::normal(distance, p) * d;
    }
    (distance(p).abs() < 5e-4).then_some(p)
}

/// Points by the cell they lie in.
struct Grid {
    cell: f64,
    points: HashMap<IVec3, Vec<DVec3>>,
}

impl Grid {
    fn new(cell: f64) -> Grid {
        Grid { cell, points: HashMap::new() }
    }

    fn insert(&mut self, p: DVec3) {
        self.points.entry((p / self.cell).floor().as_ivec3()).or_default().push(p);
    }

    /// The points of the cell of `p` and those around it.
    fn near(&self, p: DVec3) -> impl Iterator<Item = DVec3> + '_ {
        let center = (p / self.cell).floor().as_ivec3();
        let around = (0..27).map(move |i| center + IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
        around.filter_map(|cell| self.points.get(&cell)).flatten().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_is_covered_evenly() {
        let spacing = 0.1;
        let ball = |p: DVec3| p.length() - 0.5;
        let samples = cover(&ball, [DVec3::splat(-0.6), DVec3::splat(0.6)], &ball, &|_| true, spacing);
        for sample in &samples {
            assert!((sample.point.length() - 0.5).abs() < 1e-3);
            assert!(sample.normal.dot(sample.point) > 0.499);
        }
        let nearest = |p: DVec3| {
            samples.iter().map(|s| (s.point - p).length()).filter(|d| *d > 1e-9).fold(9.0, f64::min)
        };
        for sample in &samples {
            let d = nearest(sample.point);
            assert!((0.6 * spacing..1.4 * spacing).contains(&d), "a neighbour at {d}");
        }
        let gap = fibonacci_sphere(2000).map(|p| nearest(0.5 * p)).fold(0.0, f64::max);
        assert!(gap < 0.9 * spacing, "a gap of {gap}");
    }
}
