//! [`snap`]: makes static what only seems to change: a fit's motion coefficients and window widths are never exactly
//! 0 and infinite, but a package leaves out only columns that are.
//!
//! Motion and rotation become zero where no point of the Gaussian moves by [`MOTION_PX`] in any steering view while
//! it is alive. Where its opacity also changes by less than [`OPACITY_CHANGE`] over the clip, it becomes always on.
//! Position and opacity become the means of their extremes, so that the error is half of either limit.

use codec::{ALPHA_MIN, Camera, Field};
use glam::{DMat4, DQuat, DVec3, DVec4};
use rayon::prelude::*;
use refine::reference::PosedView;
use serde::Serialize;

use super::settings::{Coding, QUALITY_DB};

/// Pixels of a steering view that a Gaussian may move by and count as motionless, at [`QUALITY_DB`].
const MOTION_PX: f64 = 0.1;

/// Change of opacity below which a Gaussian counts as always on, at [`QUALITY_DB`]: half a step of an 8-bit pixel.
const OPACITY_CHANGE: f64 = 0.5 / 255.0;

/// Numbers of Gaussians that `snap` changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Snapped {
    /// Those that became static: motionless and always on.
    pub made_static: usize,
    /// Those that became motionless and keep their windows.
    pub made_motionless: usize,
}

/// What a Gaussian becomes.
struct Pose {
    row: usize,
    center: DVec3,
    rotation: DQuat,
    /// The constant opacity; `None` where the window stays.
    opacity: Option<f64>,
}

/// Makes static the Gaussians of `field` that `views` cannot tell from static ones. A target above [`QUALITY_DB`]
/// lowers both limits in proportion to the error that it allows. Temporal columns that are no longer needed are
/// removed.
pub(super) fn snap(field: &Field, views: &[PosedView], coding: Coding) -> (Field, Snapped) {
    let (mut out, mut counts) = (field.clone(), Snapped::default());
    let Some(temporal) = &mut out.temporal else { return (out, counts) };
    let finer_db = (coding.quality_db().unwrap_or(QUALITY_DB) - QUALITY_DB).max(0.0);
    let limit = libm::pow(10.0, -finer_db / 20.0);
    let viewers: Vec<Viewer> = views.iter().map(|view| Viewer::new(&view.camera)).collect();
    let poses: Vec<Pose> =
        (0..field.len()).into_par_iter().filter_map(|row| pose(field, row, &viewers, limit)).collect();
    let order = usize::from(temporal.motion_order);
    for Pose { row, center, rotation, opacity } in poses {
        out.centers[row] = center.as_vec3().to_array();
        let [x, y, z, w] = rotation.as_quat().to_array();
        out.rotations[row] = [w, x, y, z];
        temporal.motion[row * order..(row + 1) * order].fill([0.0; 3]);
        if let Some(rates) = &mut temporal.rotation_rates {
            rates[row] = [0.0; 4];
        }
        match opacity {
            Some(opacity) => {
                out.opacities[row] = opacity as f32;
                temporal.s[row] = f32::INFINITY;
                counts.made_static += 1;
            }
            None => counts.made_motionless += 1,
        }
    }
    if (0..field.len()).all(|row| temporal.is_motionless(row) && temporal.s[row].is_infinite()) {
        out.temporal = None;
    }
    (out, counts)
}

/// What Gaussian `row` becomes; `None` where it stays as it is. `limit` scales both limits.
fn pose(field: &Field, row: usize, viewers: &[Viewer], limit: f64) -> Option<Pose> {
    let temporal = field.temporal.as_ref()?;
    let opacity = constant_opacity(field, row, OPACITY_CHANGE * limit);
    let moves = !temporal.is_motionless(row);
    if !moves && (opacity.is_none() || temporal.s[row].is_infinite()) {
        return None;
    }
    let (start, end) = field.alive_interval(row)?;
    let [low, high] = field.path_bounds(row)?.map(DVec3::from_array);
    let rotation_at = |t: f64| {
        let [w, x, y, z] = field.rotation_at(row, t);
        DQuat::from_xyzw(x, y, z, w)
    };
    let (center, rotation) = (0.5 * (low + high), rotation_at(0.5 * (start + end)));
    // A rotation by an angle moves points at a distance r by at most 2 r sin(angle / 2), and unit quaternions that
    // are c apart differ by an angle with sin(angle / 2) <= c. The path between is an arc of a great circle.
    let chord = |t: f64| {
        let other = rotation_at(t);
        (DVec4::from(rotation) - DVec4::from(other)).length()
    };
    let turned = 2.0 * chord(start).max(chord(end));
    let size = radius(field, row);
    let moved = 0.5 * (high - low).length();
    let moves_visibly = || {
        let mut seen =
            viewers.iter().filter_map(|viewer| viewer.moved_px(center, size, moved, turned)).peekable();
        // Nothing is known of what no camera faces.
        seen.peek().is_none() || seen.any(|px| 2.0 * px >= MOTION_PX * limit)
    };
    if moves && moves_visibly() {
        return None;
    }
    Some(Pose { row, center, rotation, opacity })
}

/// Mean of the least and the largest opacity of a Gaussian that is alive during the whole clip and whose opacity
/// changes by less than `limit`.
fn constant_opacity(field: &Field, row: usize, limit: f64) -> Option<f64> {
    let tau = f64::from(field.temporal.as_ref()?.tau[row]);
    let [a, b, most] = [0.0, 1.0, tau.clamp(0.0, 1.0)].map(|t| field.opacity_at(row, t));
    let least = a.min(b);
    (most - least < limit && least >= ALPHA_MIN).then_some(0.5 * (least + most))
}

/// Distance from the centre at which a Gaussian fades below visibility, along its longest axis.
fn radius(field: &Field, row: usize) -> f64 {
    let longest = field.log_scales[row].into_iter().fold(f32::NEG_INFINITY, f32::max);
    let deviations = (2.0 * libm::log(f64::from(field.opacities[row]) / ALPHA_MIN)).max(0.0).sqrt();
    libm::exp(f64::from(longest)) * deviations
}

/// A camera that judges motion.
struct Viewer {
    camera_from_world: DMat4,
    /// Larger focal length in pixels.
    focal: f64,
}

impl Viewer {
    fn new(camera: &Camera) -> Viewer {
        Viewer {
            camera_from_world: DMat4::from_cols_array_2d(&camera.camera_from_world).transpose(),
            focal: camera.k[0][0].max(camera.k[1][1]),
        }
    }

    /// Upper bound, in pixels, on the displacement of any visible point of a Gaussian at `center` with the radius
    /// `size` that moves by at most `moved` and turns by at most `turned` (chord over radius); `None` where the
    /// camera never faces it, infinity where it comes too near.
    ///
    /// A splat is the affine image of its Gaussian at the depth z of the centre: a point at p from the centre lies
    /// at f (x / z + p / z), so motion displaces it by f moved (1 / z + size / z^2), times the secant of the angle to
    /// the axis, and rotation by f size turned / z.
    fn moved_px(&self, center: DVec3, size: f64, moved: f64, turned: f64) -> Option<f64> {
        let center = self.camera_from_world.transform_point3(center);
        if center.z + moved <= 0.0 {
            return None;
        }
        let nearest = center.z - moved;
        if nearest <= 0.0 {
            return Some(f64::INFINITY);
        }
        let secant = (center.length() + moved) / nearest;
        Some(self.focal * secant * (moved * (1.0 + size / nearest) + size * turned) / nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use codec::Temporal;
    use refine::reference::{Order, RenderScene, render};

    fn at(quality_db: f64) -> Coding {
        Coding::ToQuality { quality_db, joint_rounds: 0 }
    }

    /// Distance of the cameras from the origin.
    const DISTANCE: f64 = 10.0;

    /// Grey balls that are as good as always on, and motionless.
    fn balls(centers: &[[f32; 3]]) -> Field {
        let len = centers.len();
        Field {
            centers: centers.to_vec(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; len],
            log_scales: vec![[-2.0; 3]; len],
            opacities: vec![0.9; len],
            sh: vec![[1.0; 3]; len],
            temporal: Some(Temporal {
                tau: vec![0.4; len],
                s: vec![50.0; len],
                motion_order: 2,
                motion: vec![[0.0; 3]; 2 * len],
                rotation_rates: Some(vec![[0.0; 4]; len]),
            }),
            ..Field::default()
        }
    }

    fn temporal(field: &mut Field) -> &mut Temporal {
        field.temporal.as_mut().expect("a dynamic field")
    }

    /// Cameras along +z and -x, at [`DISTANCE`].
    fn views() -> Vec<PosedView> {
        let view = |position: [f64; 3]| PosedView {
            camera: Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.8, 640, 480),
            t: 0.0,
        };
        vec![view([0.0, 0.0, -DISTANCE]), view([DISTANCE, 0.0, 0.0])]
    }

    /// Pixels per unit of length at the origin.
    fn scale() -> f64 {
        views()[0].camera.k[1][1] / DISTANCE
    }

    fn counts(field: &Field, coding: Coding) -> (usize, usize) {
        let (_, Snapped { made_static, made_motionless }) = snap(field, &views(), coding);
        (made_static, made_motionless)
    }

    /// A ball at the origin that moves by so many pixels of the first view over the clip.
    fn shifted(px: f64) -> Field {
        let mut field = balls(&[[0.0; 3]]);
        temporal(&mut field).motion[0] = [0.0, (px / scale()) as f32, 0.0];
        field
    }

    #[test]
    fn motion_below_a_tenth_of_a_pixel_over_the_life_is_none() {
        assert_eq!(counts(&shifted(0.09), at(QUALITY_DB)), (1, 0));
        assert_eq!(counts(&shifted(0.11), at(QUALITY_DB)), (0, 0));
        // Back and forth: at the ends of the clip it is where it was.
        let mut there_and_back = shifted(0.0);
        temporal(&mut there_and_back).tau[0] = 0.5;
        temporal(&mut there_and_back).motion[1] = [0.0, (4.0 * 0.11 / scale()) as f32, 0.0];
        assert_eq!(counts(&there_and_back, at(QUALITY_DB)), (0, 0));
        // A tenth of the motion falls into a tenth of the clip.
        let mut short = shifted(0.5);
        temporal(&mut short).s[0] = 0.01;
        assert_eq!(counts(&short, at(QUALITY_DB)), (0, 1));
        // A higher target allows less.
        assert_eq!(counts(&shifted(0.09), at(QUALITY_DB + 6.0)), (0, 0));
        assert_eq!(counts(&shifted(0.09), at(30.0)), (1, 0));
        assert_eq!(counts(&shifted(0.09), Coding::Fixed), (1, 0));
        // The nearest camera decides.
        let mut far = views();
        far.truncate(1);
        far[0].camera.camera_from_world[2][3] += DISTANCE;
        assert_eq!(snap(&shifted(0.15), &far, at(QUALITY_DB)).1.made_static, 1);
        assert_eq!(counts(&shifted(0.15), at(QUALITY_DB)), (0, 0));
        // Nothing is known of a Gaussian behind all cameras.
        let mut behind = shifted(0.01);
        behind.centers[0] = [2.0 * DISTANCE as f32, 0.0, -2.0 * DISTANCE as f32];
        assert_eq!(counts(&behind, at(QUALITY_DB)), (0, 0));
    }

    #[test]
    fn a_needle_turns_by_what_its_ends_move() {
        let turning = |length: f32| {
            let mut field = balls(&[[0.0; 3]]);
            field.log_scales[0] = [length.ln(), -5.0, -5.0];
            temporal(&mut field).rotation_rates.as_mut().unwrap()[0] = [0.0, 0.0, 0.0, 1e-3];
            counts(&field, at(QUALITY_DB))
        };
        // Its ends, 3.3 deviations away, move by 2e-3 of that.
        let limit = 0.1 / scale() / 2e-3 / 3.3;
        assert_eq!(turning((0.8 * limit) as f32), (1, 0));
        assert_eq!(turning((1.1 * limit) as f32), (0, 0));
    }

    #[test]
    fn a_window_that_changes_by_half_an_8_bit_step_is_always_on() {
        let fading = |change: f64, tau: f32| {
            let mut field = shifted(0.01);
            let away = f64::from(tau).abs().max((1.0 - f64::from(tau)).abs());
            let near = f64::from(tau - tau.clamp(0.0, 1.0)).abs();
            // o (z^2 / 2) over the clip, as wide windows change.
            temporal(&mut field).s[0] = (0.9 * 0.5 * (away * away - near * near) / change).sqrt() as f32;
            temporal(&mut field).tau[0] = tau;
            field
        };
        for tau in [0.0, 0.5, 1.3] {
            assert_eq!(counts(&fading(0.9 / 510.0, tau), at(QUALITY_DB)), (1, 0), "{tau}");
            assert_eq!(counts(&fading(1.1 / 510.0, tau), at(QUALITY_DB)), (0, 1), "{tau}");
        }
        // Far outside the clip: constant, but at much less than its peak.
        let mut far = fading(1e-3, 20.0);
        temporal(&mut far).s[0] = 8000.0f32.sqrt() * 10.0;
        let (snapped, _) = snap(&far, &views(), at(QUALITY_DB));
        assert!(snapped.temporal.is_none());
        let error = |t: f64| (f64::from(snapped.opacities[0]) - far.opacity_at(0, t)).abs();
        assert!(error(0.0).max(error(1.0)) < 0.25 / 255.0, "{} {}", error(0.0), error(1.0));
    }

    #[test]
    fn what_moves_keeps_all_of_its_numbers() {
        let mut field = balls(&[[0.0; 3], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]);
        temporal(&mut field).motion[0] = [1e-5; 3];
        temporal(&mut field).motion[2] = [0.3; 3];
        temporal(&mut field).s[2] = 0.1;
        let (snapped, counts) = snap(&field, &views(), at(QUALITY_DB));
        assert_eq!(counts, Snapped { made_static: 1, made_motionless: 0 });
        assert_eq!(snapped.select(&[1, 2]), field.select(&[1, 2]));
        snapped.check().unwrap();
        let columns = snapped.temporal.as_ref().unwrap();
        assert!(columns.is_motionless(0) && columns.s[0] == f32::INFINITY);
        assert_eq!(snap(&snapped, &views(), at(QUALITY_DB)), (snapped, Snapped::default()), "once is enough");
    }

    /// A shift by d changes the alpha of a splat with deviation w by at most o exp(-1/2) d / w.
    #[test]
    fn pictures_change_by_no_more_than_the_limits_say() {
        let centers: Vec<[f32; 3]> =
            (0..25).map(|i| [(i % 5) as f32 - 2.0, (i / 5) as f32 - 2.0, 0.3 * (i % 3) as f32]).collect();
        let mut field = balls(&centers);
        for row in 0..centers.len() {
            let speed = (0.03 / scale()) as f32;
            let direction = row as f32;
            temporal(&mut field).motion[2 * row] = [speed * direction.sin(), speed * direction.cos(), speed];
            temporal(&mut field).motion[2 * row + 1] = [0.0, speed * direction.sin(), 0.0];
            temporal(&mut field).s[row] = 30.0;
        }
        let (snapped, Snapped { made_static, .. }) = snap(&field, &views(), at(QUALITY_DB));
        assert_eq!(made_static, centers.len());
        let deviation_px = f64::from((-2.0f32).exp()) * scale() * DISTANCE / (DISTANCE + 1.0);
        // Grey of brightness 0.5 + SH_C0.
        let brightness = 0.5 + codec::SH_C0;
        let limit = brightness * (0.9 * (-0.5f64).exp() * 0.05 / deviation_px + 0.25 / 255.0);
        let mut most: f64 = 0.0;
        for (view, t) in views().iter().flat_map(|view| [0.0, 0.4, 1.0].map(|t| (view, t))) {
            let [a, b] = [&field, &snapped]
                .map(|field| render(&RenderScene::from(field), &view.camera, t, Order::Depth));
            let errors = a.pixels.iter().zip(&b.pixels).map(|(a, b)| (a[0] - b[0]).abs());
            most = errors.fold(most, f64::max);
        }
        assert!(most < limit, "{most} of {limit}");
        assert!(most > 0.05 * limit, "the field tests the limit: {most} of {limit}");
    }
}
