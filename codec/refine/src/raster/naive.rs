//! A rasteriser that follows the equations and nothing else, to which tests hold the others: a loop over pixels and
//! Gaussians in f64, without tiles or bounds, with its own constants.
//!
//! `tests/tests/rendering` includes this file, too.

use codec::{Camera, Field, PixelFilter};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};

/// A Gaussian in the image.
struct Blob {
    depth: f64,
    center: DVec2,
    inverse_covariance: DMat2,
    opacity: f64,
    color: DVec3,
}

/// Draws `fields` at clip time `t` over black, the first field in front: red, green, blue and alpha of each pixel, row by
/// row.
pub(crate) fn draw(fields: &[&Field], camera: &Camera, t: f64) -> Vec<[f64; 4]> {
    let mut blobs = Vec::new();
    for field in fields {
        let mut layer: Vec<Blob> =
            (0..field.len()).filter_map(|row| project(field, row, camera, t)).collect();
        layer.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        blobs.extend(layer);
    }
    let centers = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    centers.map(|(x, y)| blend(&blobs, dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5))).collect()
}

/// The colour and alpha of a pixel with this centre.
fn blend(blobs: &[Blob], pixel: DVec2) -> [f64; 4] {
    let (mut color, mut transmittance) = (DVec3::ZERO, 1.0);
    for blob in blobs {
        let d = pixel - blob.center;
        let alpha = (blob.opacity * (-0.5 * d.dot(blob.inverse_covariance * d)).exp()).min(0.999);
        if alpha < 1.0 / 255.0 {
            continue;
        }
        if transmittance * (1.0 - alpha) <= 1e-4 {
            break;
        }
        color += transmittance * alpha * blob.color;
        transmittance *= 1.0 - alpha;
    }
    [color.x, color.y, color.z, 1.0 - transmittance]
}

/// A Gaussian in the image; `None` behind the camera.
fn project(field: &Field, row: usize, camera: &Camera, t: f64) -> Option<Blob> {
    let (center, rotation, opacity) = pose(field, row, t);
    let m = camera.camera_from_world;
    let world_to_view = DMat3::from_cols_array_2d(&[0, 1, 2].map(|column| [0, 1, 2].map(|r| m[r][column])));
    let view = world_to_view * center + dvec3(m[0][3], m[1][3], m[2][3]);
    let focal = dvec2(camera.k[0][0], camera.k[1][1]);
    let principal = dvec2(camera.k[0][2], camera.k[1][2]);
    let size = dvec2(f64::from(camera.width), f64::from(camera.height));
    // Gaussians fade in from half the near distance to the near distance.
    let fade = match f64::from(field.near) {
        0.0 => 1.0,
        near => ((view.z - 0.5 * near) / (0.5 * near)).clamp(0.0, 1.0),
    };
    if view.z <= 0.0 {
        return None;
    }

    // The Jacobian of the projection, at most 30 % of the half field of view outside the image.
    let margin = 0.3 * 0.5 * size / focal;
    let slope = view.truncate() / view.z;
    let at = slope.clamp(-principal / focal - margin, (size - principal) / focal + margin);
    let f = focal / view.z;
    let jacobian =
        DMat3::from_cols(dvec3(f.x, 0.0, 0.0), dvec3(0.0, f.y, 0.0), dvec3(-f.x * at.x, -f.y * at.y, 0.0));
    let deviations = DVec3::from_array(field.log_scales[row].map(|scale| f64::from(scale).exp()));
    let axes = jacobian * world_to_view * rotation * DMat3::from_diagonal(deviations);
    let covariance = DMat2::from_mat3(axes * axes.transpose());
    let (added, compensates) = match field.filter {
        PixelFilter::Blur => (0.3, false),
        PixelFilter::Mip => (0.1, true),
    };
    let filtered = covariance + DMat2::from_diagonal(DVec2::splat(added));
    let ratio = (covariance.determinant() / filtered.determinant()).max(0.0);
    Some(Blob {
        depth: view.z,
        center: focal * slope + principal,
        inverse_covariance: filtered.inverse(),
        opacity: opacity * fade * if compensates { ratio.sqrt() } else { 1.0 },
        color: color(field, row, (center - DVec3::from_array(camera.position())).normalize()),
    })
}

/// Centre, rotation and opacity at an instant.
fn pose(field: &Field, row: usize, t: f64) -> (DVec3, DMat3, f64) {
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let quaternion = |[w, x, y, z]: [f32; 4]| DQuat::from_array([x, y, z, w].map(f64::from));
    let mut center = vector(field.centers[row]);
    let mut rotation = quaternion(field.rotations[row]);
    let mut opacity = f64::from(field.opacities[row]);
    if let Some(temporal) = &field.temporal {
        let d = t - f64::from(temporal.tau[row]);
        opacity *= (-0.5 * (d / f64::from(temporal.s[row])).powi(2)).exp();
        let order = usize::from(temporal.motion_order);
        for power in 1..=order {
            center += vector(temporal.motion[row * order + power - 1]) * d.powi(power as i32);
        }
        if let Some(rates) = &temporal.rotation_rates {
            rotation += quaternion(rates[row]) * d;
        }
    }
    (center, DMat3::from_quat(rotation.normalize()), opacity)
}

/// The colour towards an eye that sees the Gaussian along the unit vector `d`, in the basis of 3D Gaussian Splatting.
fn color(field: &Field, row: usize, d: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = d;
    let basis = [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * z * z - x * x - y * y),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (x * x - y * y),
        -0.590_043_589_926_643_5 * y * (3.0 * x * x - y * y),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * z * z - x * x - y * y),
        0.373_176_332_590_115_4 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
        -0.457_045_799_464_465_8 * x * (4.0 * z * z - x * x - y * y),
        1.445_305_721_320_277 * z * (x * x - y * y),
        -0.590_043_589_926_643_5 * x * (x * x - 3.0 * y * y),
    ];
    let count = (usize::from(field.sh_degree) + 1).pow(2);
    let coefficients = &field.sh[row * count..(row + 1) * count];
    let terms = basis.iter().zip(coefficients).map(|(y, c)| *y * DVec3::from_array(c.map(f64::from)));
    (0.5 + terms.sum::<DVec3>()).clamp(DVec3::ZERO, DVec3::ONE)
}
