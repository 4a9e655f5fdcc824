//! [`floaters`]: Gaussians far from the subject, or as large as it (the paper's floater filter).
//!
//! Where the subject is, the Gaussians of a frame say themselves: their geometric median hardly
//! moves for a few that stray.

use std::collections::BTreeMap;

use super::columns::is_finite;
use super::{Bounds, Parameters, Real};
use crate::median::median;

/// A Gaussian further from the median than so many times the median distance is a floater.
const DISTANCE_MAX: f64 = 4.0;

/// Centres that the median of a frame is found from.
const SAMPLES: usize = 4096;

/// Fewer do not say where a subject is.
const SAMPLES_MIN: usize = 8;

/// Weiszfeld's algorithm converges linearly; this is to 1 % of the subject and less.
const ITERATIONS: usize = 10;

/// Of each Gaussian, whether it is a floater: further than four median distances from the geometric
/// median of the centres whose windows have the same nearest frame, or at the largest scale that the
/// bounds allow.
pub(super) fn floaters<T: Real>(parameters: &Parameters<T>, bounds: &Bounds) -> Vec<bool> {
    let largest = T::of(bounds.log_scales[1]);
    let mut found: Vec<bool> =
        parameters.log_scales.iter().map(|scales| scales.iter().any(|s| *s >= largest)).collect();
    let mut frames: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    for row in (0..parameters.len()).filter(|row| is_finite(parameters, *row)) {
        let frame = parameters.tau.get(row).map_or(0, |tau| tau.round().to_double() as i64);
        frames.entry(frame).or_default().push(row);
    }
    for rows in frames.values().filter(|rows| rows.len() >= SAMPLES_MIN) {
        let center = |row: &usize| parameters.centers[*row].map(T::to_double);
        let samples: Vec<[f64; 3]> = rows.iter().step_by(rows.len().div_ceil(SAMPLES)).map(center).collect();
        let middle = geometric_median(&samples);
        let distances = samples.iter().map(|sample| distance(*sample, middle)).collect();
        let reach = DISTANCE_MAX * median(distances).expect("there are samples");
        // Where most are in one place there is no distance to go by.
        let spread = reach > libm::exp(bounds.log_scales[0]);
        for row in rows.iter().filter(|row| spread && distance(center(row), middle) > reach) {
            found[*row] = true;
        }
    }
    found
}

/// The point with the smallest sum of distances to `points`, of which there is at least one, by
/// Weiszfeld's algorithm from their median along each axis.
fn geometric_median(points: &[[f64; 3]]) -> [f64; 3] {
    let along = |axis: usize| median(points.iter().map(|point| point[axis]).collect());
    let mut found = [0, 1, 2].map(|axis| along(axis).expect("there are points"));
    for _ in 0..ITERATIONS {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for point in points {
            let weight = 1.0 / distance(*point, found).max(f64::MIN_POSITIVE.sqrt());
            weights += weight;
            (0..3).for_each(|axis| sum[axis] += weight * point[axis]);
        }
        found = sum.map(|x| x / weights);
    }
    found
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Clock;

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
        Bounds::new(1.0, Clock { frames: 9 })
    }

    /// Of a triangle with no angle above 120 degrees it is Fermat's point: from it, all sides are
    /// seen under 120 degrees. Of (0, 0), (4, 0), (2, 3) that is (2, 2 / sqrt 3).
    #[test]
    fn the_median_of_a_triangle_is_fermats_point() {
        let [x, y, z] = geometric_median(&[[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [2.0, 3.0, 1.0]]);
        assert!((x - 2.0).abs() < 1e-3 && (y - 2.0 / 3.0_f64.sqrt()).abs() < 0.01 && z == 1.0, "{x} {y} {z}");
        assert_eq!(geometric_median(&[[1.0, 2.0, 3.0]]), [1.0, 2.0, 3.0]);
    }

    /// A cross with arms of length 1 and its middle: the median distance is 1.
    fn cross(middle: f64) -> Vec<[f64; 3]> {
        let mut points = vec![[middle, 0.0, 0.0]; 1];
        for by in [-1.0, 1.0] {
            points.extend([[middle + by, 0.0, 0.0], [middle, by, 0.0], [middle, 0.0, by]]);
        }
        points
    }

    #[test]
    fn each_frame_has_its_subject() {
        // A subject that walks by 20 from frame to frame, and one floater in each, near the other's.
        let mut centers = cross(0.0);
        centers.extend([[19.0, 0.0, 0.0], [3.5, 0.0, 0.0]]);
        centers.extend(cross(20.0));
        centers.extend([[1.0, 0.0, 0.0], [20.0, 3.0, 0.0]]);
        let tau = (0..18).map(|i| if i < 9 { 2.4 } else { 2.6 }).collect();
        let found = floaters(&at(centers, tau), &bounds());
        let rows: Vec<usize> = (0..18).filter(|row| found[*row]).collect();
        assert_eq!(rows, [7, 16]);
    }

    #[test]
    fn the_largest_allowed_scale_is_too_large() {
        let mut parameters = at(cross(0.0), Vec::new());
        parameters.log_scales[3][1] = 40.0;
        parameters.log_scales[4][1] = bounds().log_scales[1] - 1e-3;
        bounds().project(&mut parameters, 3);
        let found = floaters(&parameters, &bounds());
        assert_eq!((0..7).filter(|row| found[*row]).collect::<Vec<_>>(), [3]);
    }

    /// The largest of an imported field is no floater for that alone.
    #[test]
    fn what_was_fitted_under_other_bounds_may_stay() {
        let mut parameters = at(cross(0.0), Vec::new());
        parameters.log_scales[3] = [1.0; 3];
        let bounds = bounds().around(&parameters);
        assert!(floaters(&parameters, &bounds).iter().all(|found| !found));
        parameters.log_scales[4][1] = 40.0;
        bounds.project(&mut parameters, 4);
        assert!(floaters(&parameters, &bounds)[4]);
    }

    #[test]
    fn few_or_equal_or_broken_centers() {
        assert!(floaters(&at(Vec::new(), Vec::new()), &bounds()).is_empty());
        assert_eq!(floaters(&at(vec![[1e9; 3]], vec![1.0]), &bounds()), [false]);
        // All but one in one place: no distance to go by.
        let mut centers = vec![[1.0; 3]; 20];
        centers[7] = [2.0; 3];
        assert!(floaters(&at(centers, Vec::new()), &bounds()).iter().all(|found| !found));
        let mut centers = cross(0.0);
        centers.extend([[f64::NAN; 3], [0.5, 0.0, 0.0], [50.0, 0.0, 0.0]]);
        let found = floaters(&at(centers, Vec::new()), &bounds());
        assert_eq!((0..10).filter(|row| found[*row]).collect::<Vec<_>>(), [9]);
    }

    /// More than are sampled: the median still stands where most are.
    #[test]
    fn a_sample_finds_the_subject() {
        let on_sphere = |i: usize| {
            let (a, z) = (2.399_963 * i as f64, 1.0 - 2.0 * (i as f64 + 0.5) / 10_000.0);
            let r = (1.0 - z * z).sqrt();
            [r * a.cos(), r * a.sin(), z]
        };
        let mut centers: Vec<[f64; 3]> = (0..10_000).map(on_sphere).collect();
        for i in (0..10_000).step_by(10) {
            centers[i] = [8.0, 0.0, 0.0];
        }
        let found = floaters(&at(centers, Vec::new()), &bounds());
        assert!((0..10_000).all(|row| found[row] == (row % 10 == 0)));
    }
}
