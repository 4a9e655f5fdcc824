//! [`scatter`]: no anchor at all, Gaussians anywhere; what an anchor is held against.

use codec::Camera;

use super::eye::{Eye, nearest_to_axes};
use super::{Anchor, AnchorError};
use crate::fit::{Parameters, Real, Timeline};

/// Opacity of a Gaussian that nothing is known of, as in 3D Gaussian Splatting.
const OPACITY: f64 = 0.1;

/// Radius of the ball that they fill, as a part of the cameras' mean distance from its middle.
const REACH: f64 = 0.35;

/// Standard deviation of a Gaussian, as a part of what it would take to fill the ball side by side.
const FILLING: f64 = 0.5;

/// Gray Gaussians at random places around the point that `cameras` look at, and at random times of
/// the clip: the same for the same `seed`. Of `settings`, their number, windows and columns count.
///
/// # Errors
/// [`AnchorError::NoMiddle`] where the cameras do not look at one point.
pub fn scatter(
    settings: &Anchor,
    timeline: Timeline,
    cameras: &[&Camera],
    seed: u64,
) -> Result<Parameters<f32>, AnchorError> {
    let eyes: Vec<Eye> = cameras.iter().map(|camera| Eye::new(camera)).collect();
    let center = nearest_to_axes(&eyes).ok_or(AnchorError::NoMiddle)?;
    let distance = eyes.iter().map(|eye| eye.position.distance(center)).sum::<f64>() / eyes.len() as f64;
    let radius = REACH * distance;
    let count = settings.gaussians;
    let scale = FILLING * radius / libm::cbrt(count.max(1) as f64);
    let timed = timeline.frames > 1;
    let columns = Parameters {
        sh_degree: settings.sh_degree,
        motion_order: if timed { settings.motion_order } else { 0 },
        // Its length says only whether there is time at all.
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
            all.tau[i] = f32::from_f64(random.f64() * timeline.frames_per_clip());
            all.log_widths[i] = f32::from_f64(libm::log(settings.width));
        }
    }
    Ok(all)
}

/// A point of the unit ball, each as likely as any other.
fn in_ball(random: &mut fastrand::Rng) -> [f64; 3] {
    loop {
        let place: [f64; 3] = std::array::from_fn(|_| 2.0 * random.f64() - 1.0);
        if place.iter().map(|x| x * x).sum::<f64>() <= 1.0 {
            return place;
        }
    }
}
