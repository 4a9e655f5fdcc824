//! Mirrors the back side (the paper's `eq:mirror`), for captures from one side.
//!
//! The paper gives the reflection of a centre; the reflections of covariance and motion follow. With
//! unit normal `n` and `H = I - 2 n n^T`, a covariance becomes `H Sigma H`, so axes `R` become
//! `H R diag(1, 1, -1)`, again a rotation. As quaternions, with `n` and `k = (0, 0, 1)` pure:
//! `H x = n x n`, hence `q' = n q k`.

use glam::{DQuat, DVec3};

use super::ground::BEHIND;
use super::pinhole::Pinhole;
use crate::fit::Parameters;

/// Least length of the mean of the views' horizontal directions for a capture from one side: the length
/// is 1 for one view, 0.9 for an arc of 90 degrees, 0.64 for a half circle and 0 for a ring.
const ONE_SIDED: f64 = 0.6;

/// The plane between front and back.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// A point on the plane.
    pub(super) point: DVec3,
    /// Unit normal.
    pub(super) normal: DVec3,
}

/// Mean horizontal viewing direction of `views`; `None` if they look from all sides. Up is the mean image
/// up of all cameras, `rig`.
pub(super) fn front(views: &[Pinhole], rig: &[Pinhole]) -> Option<DVec3> {
    let up = rig.iter().map(|pinhole| pinhole.up).sum::<DVec3>().try_normalize()?;
    let level = |pinhole: &Pinhole| pinhole.forward.reject_from_normalized(up).try_normalize();
    let mean = views.iter().filter_map(level).sum::<DVec3>() / views.len() as f64;
    if mean.length() > ONE_SIDED { mean.try_normalize() } else { None }
}

/// The mirrored Gaussians: same colours, [`BEHIND`] times the opacity.
pub(super) fn mirrored(front: &Parameters<f32>, plane: Plane) -> Parameters<f32> {
    let n = plane.normal;
    let across = |v: DVec3| v - 2.0 * v.dot(n) * n;
    let vector = |v: &[f32; 3]| across(DVec3::from_array(v.map(f64::from))).to_array().map(|x| x as f32);
    let point = |p: &[f32; 3]| {
        let away = DVec3::from_array(p.map(f64::from)) - plane.point;
        (plane.point + across(away)).to_array().map(|x| x as f32)
    };
    // Linear in q, so it holds for rates and for quaternions of any length, too.
    let turn = |q: &[f32; 4]| {
        let [w, x, y, z] = q.map(f64::from);
        let pure = |v: DVec3| DQuat::from_xyzw(v.x, v.y, v.z, 0.0);
        let q = pure(n) * DQuat::from_xyzw(x, y, z, w) * pure(DVec3::Z);
        [q.w, q.x, q.y, q.z].map(|x| x as f32)
    };
    Parameters {
        centers: front.centers.iter().map(point).collect(),
        rotations: front.rotations.iter().map(turn).collect(),
        logits: front.logits.iter().map(|&a| fainter(a)).collect(),
        motion: front.motion.iter().map(vector).collect(),
        rotation_rates: front.rotation_rates.iter().map(turn).collect(),
        ..front.clone()
    }
}

/// Logit of [`BEHIND`] times the opacity.
fn fainter(logit: f32) -> f32 {
    let opacity = BEHIND / (1.0 + libm::exp(-f64::from(logit)));
    libm::log(opacity / (1.0 - opacity)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::test_scene::ring;
    use glam::DMat3;

    fn gaussians() -> Parameters<f32> {
        Parameters {
            centers: vec![[0.3, 1.2, -0.4], [1.0, 0.0, 2.0]],
            rotations: vec![[0.5, -0.1, 0.7, 0.2], [2.0, 0.3, 0.0, -1.0]],
            log_scales: vec![[-3.0, -2.0, -1.0], [-1.0, 0.5, -4.0]],
            logits: vec![0.0, 1.0],
            sh: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]],
            tau: vec![0.0, 1.0],
            log_widths: vec![0.0, 1.0],
            motion_order: 1,
            motion: vec![[0.1, 0.2, 0.3], [0.0, -1.0, 0.5]],
            rotation_rates: vec![[0.1, 0.0, 0.2, 0.0], [0.0, 0.3, 0.0, 0.1]],
            ..Parameters::default()
        }
    }

    fn plane() -> Plane {
        Plane { point: DVec3::new(0.2, 1.0, 0.1), normal: DVec3::new(1.0, 0.0, 2.0).normalize() }
    }

    fn covariance(p: &Parameters<f32>, i: usize, time: f64) -> DMat3 {
        let at = |axis: usize| f64::from(p.rotations[i][axis]) + time * f64::from(p.rotation_rates[i][axis]);
        let q = DQuat::from_xyzw(at(1), at(2), at(3), at(0)).normalize();
        let s = DVec3::from_array(p.log_scales[i].map(|s| f64::from(s).exp()));
        let axes = DMat3::from_quat(q) * DMat3::from_diagonal(s);
        axes * axes.transpose()
    }

    #[test]
    fn covariances_are_reflected_at_all_times() {
        let (before, after) = (gaussians(), mirrored(&gaussians(), plane()));
        let n = plane().normal;
        let h = DMat3::IDENTITY - 2.0 * DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        for i in 0..2 {
            for time in [0.0, 1.5] {
                let expected = h * covariance(&before, i, time) * h;
                assert!(covariance(&after, i, time).abs_diff_eq(expected, 1e-5), "{i} at {time}");
            }
            let half_way = 0.5
                * (DVec3::from_array(before.centers[i].map(f64::from))
                    + DVec3::from_array(after.centers[i].map(f64::from)));
            assert!((half_way - plane().point).dot(n).abs() < 1e-6, "the plane lies half way");
            let motion = h * DVec3::from_array(before.motion[i].map(f64::from));
            assert!(DVec3::from_array(after.motion[i].map(f64::from)).abs_diff_eq(motion, 1e-6));
        }
        assert_eq!((&after.sh, &after.tau, &after.log_scales), (&before.sh, &before.tau, &before.log_scales));
    }

    #[test]
    fn mirroring_twice_restores_all_but_opacity() {
        let before = gaussians();
        let back = mirrored(&mirrored(&before, plane()), plane());
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        for i in 0..2 {
            assert!(near(&back.centers[i], &before.centers[i]) && near(&back.motion[i], &before.motion[i]));
            // q and -q are the same rotation.
            let same = near(&back.rotations[i], &before.rotations[i]);
            assert!(same || near(&back.rotations[i], &before.rotations[i].map(|x| -x)));
        }
        assert!((back.logits[0] - (0.125f32 / 0.875).ln()).abs() < 1e-6, "a quarter of 0.5");
    }

    #[test]
    fn only_one_sided_captures_have_a_front() {
        let pinholes: Vec<Pinhole> = ring(16, 3.0, 16).iter().map(Pinhole::new).collect();
        assert!(front(&pinholes, &pinholes).is_none());
        assert!(front(&[], &pinholes).is_none());
        let normal = front(&pinholes[..1], &pinholes).unwrap();
        let up = pinholes.iter().map(|pinhole| pinhole.up).sum::<DVec3>().normalize();
        assert!(normal.dot(up).abs() < 1e-9 && normal.dot(pinholes[0].forward) > 0.8);
        assert!(front(&pinholes[..5], &pinholes).is_some(), "a quarter of the ring");
    }
}
