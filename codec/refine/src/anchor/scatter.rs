//! [`scatter`]: random Gaussians instead of an anchor, the baseline that anchors are compared with.

use codec::Camera;

use super::pinhole::{Pinhole, common_point};
use super::{AnchorError, AnchorSettings};
use crate::fit::{Parameters, Real, Timeline};

/// Initial opacity, as in 3D Gaussian Splatting.
const OPACITY: f64 = 0.1;

/// Radius of the ball of Gaussians, as a fraction of the cameras' mean distance from its centre.
const BALL_RADIUS: f64 = 0.35;

/// Standard deviation of a Gaussian, as a fraction of the size that fills the ball without gaps.
const FILLING: f64 = 0.5;

/// Gray Gaussians at random positions around the point that `cameras` look at, and at random times of
/// the clip. The result depends on `seed` only. From `settings` it takes the number of Gaussians, their
/// temporal width, the filter and the columns.
///
/// # Errors
/// [`AnchorError::NoCenter`] if the cameras do not look at one point.
pub fn scatter(
    settings: &AnchorSettings,
    timeline: Timeline,
    cameras: &[&Camera],
    seed: u64,
) -> Result<Parameters<f32>, AnchorError> {
    let pinholes: Vec<Pinhole> = cameras.iter().map(|camera| Pinhole::new(camera)).collect();
    let center = common_point(&pinholes).ok_or(AnchorError::NoCenter)?;
    let distance =
        pinholes.iter().map(|pinhole| pinhole.position.distance(center)).sum::<f64>() / pinholes.len() as f64;
    let radius = BALL_RADIUS * distance;
    let count = settings.gaussians;
    let scale = FILLING * radius / libm::cbrt(count.max(1) as f64);
    let timed = timeline.frames > 1;
    let columns = Parameters {
        sh_degree: settings.sh_degree,
        filter: settings.filter,
        near: settings.near,
        motion_order: if timed { settings.motion_order } else { 0 },
        // Only its emptiness matters: it tells `zeros` whether to make temporal columns.
        tau: vec![0.0; usize::from(timed)],
        ..Parameters::default()
    };
    let mut all = columns.zeros(count);
    let mut random = fastrand::Rng::with_seed(seed);
    for i in 0..count {
        let place = in_ball(&mut random);
        all.centers[i] = std::array::from_fn(|axis| f32::from_f64(center[axis] + radius * place[axis]));
        all.rotations[i] = [1.0, 0.0, 0.0, 0.0];
        all.log_scales[i] = [f32::from_f64(libm::log(scale)); 3];
        all.logits[i] = f32::from_f64(libm::log(OPACITY / (1.0 - OPACITY)));
        if timed {
            all.tau[i] = f32::from_f64(random.f64() * timeline.intervals);
            all.log_widths[i] = f32::from_f64(libm::log(settings.width));
        }
    }
    Ok(all)
}

/// A uniformly distributed point of the unit ball.
fn in_ball(random: &mut fastrand::Rng) -> [f64; 3] {
    loop {
        let place: [f64; 3] = std::array::from_fn(|_| 2.0 * random.f64() - 1.0);
        if place.iter().map(|x| x * x).sum::<f64>() <= 1.0 {
            return place;
        }
    }
}
