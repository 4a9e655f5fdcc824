//! [`PosedView`]s to rank and compare fields by.
//!
//! Viewpoints that a source suggests are used together with cameras slightly aside, since a head moves. All other cameras
//! come from [`codec::Surroundings`].

use codec::{Camera, Field, Viewpoint};
use glam::{DQuat, DVec3};

use crate::reference::PosedView;

/// Views of every camera at every instant, in clip time.
pub fn posed_views(cameras: &[Camera], instants: &[f64]) -> Vec<PosedView> {
    let view = |camera: &Camera, t| PosedView { camera: camera.clone(), t };
    instants.iter().flat_map(|&t| cameras.iter().map(move |camera| view(camera, t))).collect()
}

/// The centres of `count` equal intervals of the clip; only the start if `field` is static.
pub fn instants(field: &Field, count: usize) -> Vec<f64> {
    match field.temporal {
        Some(_) => (0..count).map(|i| (i as f64 + 0.5) / count as f64).collect(),
        None => vec![0.0],
    }
}

/// Five cameras of `size` pixels that look at the target of `viewpoint`: one at its position, the others
/// turned around the target by `angle` radians to the left, right, top and bottom.
pub fn steps_aside(viewpoint: &Viewpoint, up: [f32; 3], angle: f64, size: (u32, u32)) -> Vec<Camera> {
    let target = DVec3::from_array(viewpoint.target.map(f64::from));
    let arm = DVec3::from_array(viewpoint.position.map(f64::from)) - target;
    let up = DVec3::from_array(up.map(f64::from)).normalize_or(DVec3::Y);
    let across = arm.cross(up).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let turns = [(up, 0.0), (up, angle), (up, -angle), (across, angle), (across, -angle)];
    let camera = |(axis, angle): (DVec3, f64)| {
        let (sin, cos) = libm::sincos(0.5 * angle);
        let turn = DQuat::from_xyzw(sin * axis.x, sin * axis.y, sin * axis.z, cos);
        let position = target + turn * arm;
        let fov_y = f64::from(viewpoint.fov_y);
        Camera::look_at(position.to_array(), target.to_array(), up.to_array(), fov_y, size.0, size.1)
    };
    turns.map(camera).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::balls;

    #[test]
    fn a_viewpoint_right_above_has_steps_aside() {
        let viewpoint =
            Viewpoint { name: "top".into(), position: [0.0, 5.0, 0.0], target: [0.0; 3], fov_y: 1.0 };
        let cameras = steps_aside(&viewpoint, [0.0, 1.0, 0.0], 0.1, (8, 8));
        assert!(cameras.iter().all(|camera| camera.check().is_ok()));
    }

    #[test]
    fn steps_aside_preserve_distance_and_target() {
        let viewpoint =
            Viewpoint { name: "v".into(), position: [1.0, 2.0, 5.0], target: [1.0, 1.0, 0.0], fov_y: 0.8 };
        let up = [0.0, 1.0, 0.0];
        let cameras = steps_aside(&viewpoint, up, 0.2, (64, 48));
        assert_eq!(cameras[0], viewpoint.camera(up, 64, 48));
        let target = DVec3::new(1.0, 1.0, 0.0);
        let arm = |camera: &Camera| DVec3::from_array(camera.position()) - target;
        for camera in &cameras[1..] {
            assert!((arm(camera).length() - arm(&cameras[0]).length()).abs() < 1e-6);
        }
        assert!((arm(&cameras[3]).angle_between(arm(&cameras[0])) - 0.2).abs() < 1e-6);
        assert!((arm(&cameras[1]) - arm(&cameras[2])).length() > 1.0);
    }

    #[test]
    fn instants_are_centres_of_intervals() {
        let mut field = balls(&[[0.0; 3]], 0.1, 0.9);
        assert_eq!(instants(&field, 4), [0.0]);
        field.temporal = Some(codec::Temporal { tau: vec![0.5], s: vec![1.0], ..Default::default() });
        assert_eq!(instants(&field, 4), [0.125, 0.375, 0.625, 0.875]);
    }

    #[test]
    fn steps_aside_go_to_all_four_sides() {
        let viewpoint =
            Viewpoint { name: "v".into(), position: [0.0, 0.0, 5.0], target: [0.0; 3], fov_y: 0.8 };
        let cameras = steps_aside(&viewpoint, [0.0, 1.0, 0.0], 0.2, (64, 48));
        let step = 5.0 * 0.2_f64.sin();
        let mut sides: Vec<[i32; 2]> = cameras[1..]
            .iter()
            .map(|camera| [0, 1].map(|axis| (camera.position()[axis] / step).round() as i32))
            .collect();
        sides.sort_unstable();
        assert_eq!(sides, [[-1, 0], [0, -1], [0, 1], [1, 0]]);
    }
}
