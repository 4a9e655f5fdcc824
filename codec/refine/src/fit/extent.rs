//! [`extent`]: the length that steps and bounds are parts of.

use codec::Camera;

/// How much larger a scene is taken to be than its rig, as in 3D Gaussian Splatting.
const MARGIN: f64 = 1.1;

/// Size of a scene in units of the capture: 1.1 times the largest distance of a camera from the mean of
/// the cameras, as in 3D Gaussian Splatting; where there is only one place, 1.1 times its distance
/// from the mean of `centers`. 1 where that is nothing either.
pub(super) fn extent<'a>(cameras: impl IntoIterator<Item = &'a Camera>, centers: &[[f32; 3]]) -> f64 {
    let eyes: Vec<[f64; 3]> = cameras.into_iter().map(Camera::position).collect();
    let middle = mean(&eyes);
    let radius = eyes.iter().map(|eye| distance(*eye, middle)).fold(0.0, f64::max);
    let centers: Vec<[f64; 3]> = centers.iter().map(|center| center.map(f64::from)).collect();
    let away = distance(middle, mean(&centers));
    // Cameras of one place differ by what calibration leaves.
    let size = if radius > 1e-3 * away { radius } else { away };
    if size > 0.0 && size.is_finite() { MARGIN * size } else { 1.0 }
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    let sum = points.iter().fold([0.0; 3], |sum, point| [0, 1, 2].map(|axis| sum[axis] + point[axis]));
    sum.map(|x| x / points.len().max(1) as f64)
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(position: [f64; 3]) -> Camera {
        Camera::look_at(position, [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 8, 8)
    }

    #[test]
    fn a_rig_has_the_size_of_its_ring() {
        let ring = [camera([3.0, 1.0, 0.0]), camera([-3.0, 1.0, 0.0])];
        assert!((extent(&ring, &[]) - 3.3).abs() < 1e-12);
    }

    #[test]
    fn one_place_is_as_far_as_what_it_sees() {
        let one = [camera([0.0; 3])];
        assert!((extent(&one, &[[0.0, 0.0, 2.0], [0.0, 0.0, 4.0]]) - 3.3).abs() < 1e-12);
        assert_eq!(extent(&one, &[]), 1.0);
        assert_eq!(extent(&[], &[[0.0; 3]]), 1.0);
    }
}
