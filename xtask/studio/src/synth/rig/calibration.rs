//! The cameras as `calibration.toml`, in the layout that Pose2Sim, Caliscope and aniposelib share.
//!
//! Its numbers are OpenCV's: pixel centres are at whole numbers, so the principal point is half a pixel less than in
//! [`Camera`]; `rotation` is the axis of the turn from world to camera times its angle in radians.

use codec::Camera;
use glam::{DMat3, DQuat, DVec3, dvec3};

use crate::synth::stage::name;

/// The file of all cameras.
pub(super) fn calibration(cameras: &[Camera]) -> String {
    let sections = cameras.iter().enumerate().map(|(number, camera)| section(&name(number), camera));
    let metadata = "[metadata]\nadjusted = false\nerror = 0.0\n";
    sections.chain([metadata.into()]).collect::<Vec<String>>().join("\n")
}

fn section(name: &str, camera: &Camera) -> String {
    let Camera { width, height, k, camera_from_world: m } = camera;
    let [fx, fy] = [k[0][0], k[1][1]];
    let [cx, cy] = [k[0][2] - 0.5, k[1][2] - 0.5];
    let [rx, ry, rz] = rotation_vector(m).to_array();
    // Debug writes a floating-point number as TOML has it, with a point, and enough digits.
    [
        format!(
            "[cam_{name}]\nname = \"{name}\"\nsize = [ {:?}, {:?}]",
            f64::from(*width),
            f64::from(*height)
        ),
        format!("matrix = [ [ {fx:?}, 0.0, {cx:?}], [ 0.0, {fy:?}, {cy:?}], [ 0.0, 0.0, 1.0]]"),
        "distortions = [ 0.0, 0.0, 0.0, 0.0]".into(),
        format!("rotation = [ {rx:?}, {ry:?}, {rz:?}]"),
        format!("translation = [ {:?}, {:?}, {:?}]\nfisheye = false\n", m[0][3], m[1][3], m[2][3]),
    ]
    .join("\n")
}

/// Axis times angle of the rotation in a transform.
fn rotation_vector(m: &[[f64; 4]; 4]) -> DVec3 {
    let column = |c: usize| dvec3(m[0][c], m[1][c], m[2][c]);
    let turn = DQuat::from_mat3(&DMat3::from_cols(column(0), column(1), column(2)));
    // A turn by more than half of a full one is a smaller turn the other way.
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let (axis, cosine) = (dvec3(turn.x, turn.y, turn.z), turn.w);
    let sine = axis.length();
    match sine > 0.0 {
        true => axis * (2.0 * libm::atan2(sine, cosine) / sine),
        false => DVec3::ZERO,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_vectors_turn_as_the_matrix_does() {
        for position in
            [[3.0, 1.2, 0.1], [0.0, 1.2, 3.0], [0.0, 1.0, -3.0], [-2.0, 2.2, 1.0], [0.0, 4.0, 0.1]]
        {
            let camera = Camera::look_at(position, [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], 0.8, 64, 48);
            let vector = rotation_vector(&camera.camera_from_world);
            assert!(vector.length() <= std::f64::consts::PI + 1e-12, "{vector}");
            // Rodrigues' formula.
            let (axis, (sin, cos)) = (vector.normalize(), libm::sincos(vector.length()));
            for c in 0..3 {
                let unit = DVec3::AXES[c];
                let turned = unit * cos + axis.cross(unit) * sin + axis * (axis.dot(unit) * (1.0 - cos));
                let expected = DVec3::from([0, 1, 2].map(|r| camera.camera_from_world[r][c]));
                assert!(turned.distance(expected) < 1e-12, "{turned} {expected}");
            }
        }
    }

    #[test]
    fn the_principal_point_is_that_of_opencv() {
        let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], 0.8, 64, 48);
        let text = calibration(&[camera]);
        assert!(text.starts_with("[cam_00]\nname = \"00\"\nsize = [ 64.0, 48.0]\nmatrix = [ [ "), "{text}");
        assert!(
            text.contains(", 0.0, 31.5], [ 0.0, ") && text.contains(", 23.5], [ 0.0, 0.0, 1.0]]"),
            "{text}"
        );
        assert!(text.ends_with("fisheye = false\n\n[metadata]\nadjusted = false\nerror = 0.0\n"), "{text}");
    }
}
