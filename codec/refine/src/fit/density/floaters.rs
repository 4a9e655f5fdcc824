//! [`floaters`]: Gaussians far from the subject, or moving ones as large as it (the paper's floater filter).
//!
//! The subject is where the Gaussians of an interval are: their geometric median, which a few strays hardly
//! move.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::fit::parameters::{Bounds, Parameters};
use crate::median::median;
use crate::raster::Real;

/// A floater is further from the median than this multiple of the median distance.
const DISTANCE_MAX: f64 = 4.0;

/// Largest number of centres that the median of an interval is computed from.
const SAMPLES: usize = 4096;

/// Smallest number of Gaussians that locate a subject.
const SAMPLES_MIN: usize = 8;

/// Iterations of Weiszfeld's algorithm, which converges linearly: an error below 1 % of the subject.
const ITERATIONS: usize = 10;

/// Whether each Gaussian is a floater: at the largest scale that the bounds allow if it moves (a bare wall is of few large
/// ones, which would be dropped again and again), or further than four
/// median distances from the geometric median of the centres in its interval. A Gaussian belongs to the
/// whole interval nearest to its window's centre; those that are always on are a group of their own.
pub(super) fn floaters<T: Real>(
    parameters: &Parameters<T>,
    is_static: impl Fn(usize) -> bool,
    bounds: &Bounds,
) -> Vec<bool> {
    let largest = T::from_f64(bounds.log_scales[1]);
    let moves = |row: usize| !parameters.tau.is_empty() && !is_static(row);
    let is_large = |row: usize| parameters.log_scales[row].iter().any(|scale| *scale >= largest);
    let mut floating: Vec<bool> = (0..parameters.len()).map(|row| moves(row) && is_large(row)).collect();
    let mut frames: BTreeMap<Option<i64>, Vec<usize>> = BTreeMap::new();
    for row in (0..parameters.len()).filter(|row| parameters.is_finite(*row)) {
        let frame = moves(row).then(|| parameters.tau[row].round().to_double() as i64);
        frames.entry(frame).or_default().push(row);
    }
    for rows in frames.values().filter(|rows| rows.len() >= SAMPLES_MIN) {
        let center = |row: &usize| DVec3::from_array(parameters.centers[*row].map(T::to_double));
        let samples: Vec<DVec3> = rows.iter().step_by(rows.len().div_ceil(SAMPLES)).map(center).collect();
        let subject = geometric_median(&samples);
        let distances = samples.iter().map(|sample| sample.distance(subject)).collect();
        let limit = DISTANCE_MAX * median(distances).expect("there are samples");
        // If most centres coincide, the median distance is meaningless.
        let is_spread = limit > libm::exp(bounds.log_scales[0]);
        for row in rows.iter().filter(|row| is_spread && center(row).distance(subject) > limit) {
            floating[*row] = true;
        }
    }
    floating
}

/// The point with the smallest sum of distances to `points`, by Weiszfeld's algorithm from their median
/// along each axis. `points` is not empty.
fn geometric_median(points: &[DVec3]) -> DVec3 {
    let along = |axis: usize| median(points.iter().map(|point| point[axis]).collect());
    let mut found = DVec3::from_array([0, 1, 2].map(|axis| along(axis).expect("there are points")));
    for _ in 0..ITERATIONS {
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for point in points {
            let weight = 1.0 / point.distance(found).max(f64::MIN_POSITIVE.sqrt());
            weights += weight;
            sum += weight * *point;
        }
        found = sum / weights;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::parameters::Timeline;

    fn at(centers: Vec<[f64; 3]>, tau: Vec<f64>) -> Parameters<f64> {
        let rows = centers.len();
        Parameters {
            centers,
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows],
            log_scales: vec![[-5.0; 3]; rows],
            logits: vec![0.0; rows],
            sh: vec![[0.0; 3]; rows],
            log_widths: vec![0.5; tau.len()],
            tau,
            ..Parameters::default()
        }
    }

    fn bounds() -> Bounds {
        Bounds::new(1.0, Timeline::even(9))
    }

    /// The geometric median of a triangle with no angle above 120 degrees is its Fermat point, which
    /// sees all sides at 120 degrees: (2, 2 / sqrt 3) for (0, 0), (4, 0), (2, 3).
    #[test]
    fn the_median_of_a_triangle_is_its_fermat_point() {
        let triangle = [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [2.0, 3.0, 1.0]].map(DVec3::from_array);
        let [x, y, z] = geometric_median(&triangle).to_array();
        assert!((x - 2.0).abs() < 1e-3 && (y - 2.0 / 3.0_f64.sqrt()).abs() < 0.01 && z == 1.0, "{x} {y} {z}");
        let point = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(geometric_median(&[point]), point);
    }

    /// A cross with arms of length 1, and its center: the median distance is 1.
    fn cross(center: f64) -> Vec<[f64; 3]> {
        let mut points = vec![[center, 0.0, 0.0]];
        for by in [-1.0, 1.0] {
            points.extend([[center + by, 0.0, 0.0], [center, by, 0.0], [center, 0.0, by]]);
        }
        points
    }

    #[test]
    fn each_frame_has_its_subject() {
        // A subject that moves by 20 between frames. Each frame has a floater near the other frame's subject.
        let mut centers = cross(0.0);
        centers.extend([[19.0, 0.0, 0.0], [3.5, 0.0, 0.0]]);
        centers.extend(cross(20.0));
        centers.extend([[1.0, 0.0, 0.0], [20.0, 3.0, 0.0]]);
        let tau = (0..18).map(|i| if i < 9 { 2.4 } else { 2.6 }).collect();
        let found = floaters(&at(centers, tau), |_| false, &bounds());
        let rows: Vec<usize> = (0..18).filter(|row| found[*row]).collect();
        assert_eq!(rows, [7, 16]);
    }

    /// A room around a subject: its walls are far from the subject, but not from each other.
    #[test]
    fn what_is_always_on_is_judged_by_itself() {
        let mut centers = [cross(0.0), cross(0.0)].concat();
        centers.extend((0..8).map(|i| [if i % 2 == 0 { 9.0 } else { -9.0 }, f64::from(i), 5.0]));
        let all = at(centers, vec![4.0; 22]);
        let found = |is_static: &dyn Fn(usize) -> bool| {
            floaters(&all, is_static, &bounds()).iter().filter(|floats| **floats).count()
        };
        assert_eq!(found(&|row| row >= 14), 0);
        assert_eq!(found(&|_| false), 8, "beside the subject, the room floats");
    }

    #[test]
    fn what_moves_may_not_have_the_largest_scale() {
        let mut parameters = at(cross(0.0), vec![1.0; 7]);
        parameters.log_scales[3][1] = 40.0;
        parameters.log_scales[4][1] = bounds().log_scales[1] - 1e-3;
        bounds().project(parameters.row_mut(3));
        let found = floaters(&parameters, |_| false, &bounds());
        assert_eq!((0..7).filter(|row| found[*row]).collect::<Vec<_>>(), [3]);
        // A wall may.
        assert!(!floaters(&parameters, |row| row == 3, &bounds())[3]);
        let wall = Parameters { tau: Vec::new(), log_widths: Vec::new(), ..parameters };
        assert!(floaters(&wall, |_| false, &bounds()).iter().all(|found| !found));
    }

    #[test]
    fn the_largest_gaussian_of_an_imported_field_is_no_floater() {
        let mut parameters = at(cross(0.0), vec![1.0; 7]);
        parameters.log_scales[3] = [1.0; 3];
        let bounds = bounds().around(&parameters);
        assert!(floaters(&parameters, |_| false, &bounds).iter().all(|found| !found));
        parameters.log_scales[4][1] = 40.0;
        bounds.project(parameters.row_mut(4));
        assert!(floaters(&parameters, |_| false, &bounds)[4]);
    }

    #[test]
    fn few_or_equal_or_non_finite_centers() {
        assert!(floaters(&at(Vec::new(), Vec::new()), |_| false, &bounds()).is_empty());
        assert_eq!(floaters(&at(vec![[1e9; 3]], vec![1.0]), |_| false, &bounds()), [false]);
        // All but one coincide: the median distance is 0.
        let mut centers = vec![[1.0; 3]; 20];
        centers[7] = [2.0; 3];
        assert!(floaters(&at(centers, Vec::new()), |_| false, &bounds()).iter().all(|found| !found));
        let mut centers = cross(0.0);
        centers.extend([[f64::NAN; 3], [0.5, 0.0, 0.0], [50.0, 0.0, 0.0]]);
        let found = floaters(&at(centers, Vec::new()), |_| false, &bounds());
        assert_eq!((0..10).filter(|row| found[*row]).collect::<Vec<_>>(), [9]);
    }

    #[test]
    fn a_sample_of_the_centers_locates_the_subject() {
        let on_sphere = |i: usize| {
            let (a, z) = (2.399_963 * i as f64, 1.0 - 2.0 * (i as f64 + 0.5) / 10_000.0);
            let r = (1.0 - z * z).sqrt();
            [r * a.cos(), r * a.sin(), z]
        };
        let mut centers: Vec<[f64; 3]> = (0..10_000).map(on_sphere).collect();
        for i in (0..10_000).step_by(10) {
            centers[i] = [8.0, 0.0, 0.0];
        }
        let found = floaters(&at(centers, Vec::new()), |_| false, &bounds());
        assert!((0..10_000).all(|row| found[row] == (row % 10 == 0)));
    }
}
