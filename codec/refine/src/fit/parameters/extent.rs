//! [`scene_extent`]: the unit of learning rates and bounds.

use codec::Camera;
use glam::DVec3;

/// Extent of a scene per radius of its rig, as in 3D Gaussian Splatting.
const MARGIN: f64 = 1.1;

/// Size of a scene in units of the capture: 1.1 times the largest distance of a camera from the mean
/// camera position, as in 3D Gaussian Splatting. If all cameras are in one place, 1.1 times the distance
/// from there to the mean of `centers`; 1 if that is zero, too.
pub(in crate::fit) fn scene_extent<'a>(
    cameras: impl IntoIterator<Item = &'a Camera>,
    centers: &[[f32; 3]],
) -> f64 {
    let eyes: Vec<DVec3> = cameras.into_iter().map(|camera| DVec3::from_array(camera.position())).collect();
    let center = mean(&eyes);
    let radius = eyes.iter().map(|eye| eye.distance(center)).fold(0.0, f64::max);
    let centers: Vec<DVec3> = centers.iter().map(|center| DVec3::from_array(center.map(f64::from))).collect();
    let away = center.distance(mean(&centers));
    // Calibration noise separates the positions of a camera that did not move.
    let size = if radius > 1e-3 * away { radius } else { away };
    if size > 0.0 && size.is_finite() { MARGIN * size } else { 1.0 }
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
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
        assert!((scene_extent(&ring, &[]) - 3.3).abs() < 1e-12);
    }

    #[test]
    fn a_single_position_measures_the_distance_to_the_scene() {
        let one = [camera([0.0; 3])];
        assert!((scene_extent(&one, &[[0.0, 0.0, 2.0], [0.0, 0.0, 4.0]]) - 3.3).abs() < 1e-12);
        assert_eq!(scene_extent(&one, &[]), 1.0);
        assert_eq!(scene_extent(&[], &[[0.0; 3]]), 1.0);
    }
}
