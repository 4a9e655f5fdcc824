//! [`color_disagreement`]: by how much cameras show the same surfaces in other colours.
//!
//! Gaussians of an anchor have the colours that some cameras show at their centres. The other cameras show them, or what
//! is in front, in theirs. The median of the ratios over many Gaussians is what a camera does to colours: occlusion and
//! texture put as many above it as below.

use codec::{SH_C0, sh_coefficients};
use rayon::prelude::*;

use crate::fit::parameters::Parameters;
use crate::fit::views::TrainingView;
use crate::median::median;

/// Darkest level that is compared, of 255: the ratios of darker ones are noise.
const DARKEST: f64 = 25.0;

/// Fewest Gaussians that tell the gain of a camera.
const SAMPLES_MIN: usize = 64;

/// Root mean square of the logarithms of the gains of the colour channels, over the cameras of `views`: 0 for cameras that
/// agree, 0.1 for some that differ by a tenth. `parameters` are Gaussians on the surfaces that the views show. `None` if
/// fewer than two cameras show enough of them.
pub fn color_disagreement(parameters: &Parameters<f32>, views: &[&TrainingView]) -> Option<f64> {
    let each = sh_coefficients(parameters.sh_degree);
    let ratios: Vec<(usize, [Vec<f64>; 3])> =
        views.par_iter().map(|view| (view.camera_id, ratios(parameters, each, view))).collect();
    let cameras = views.iter().map(|view| view.camera_id + 1).max()?;
    let mut by_camera: Vec<[Vec<f64>; 3]> = vec![Default::default(); cameras];
    for (camera, ratios) in ratios {
        by_camera[camera].iter_mut().zip(ratios).for_each(|(all, ratios)| all.extend(ratios));
    }
    let mut square = 0.0;
    let mut known = 0;
    for channel in 0..3 {
        let of_channel = by_camera.iter().map(|channels| &channels[channel]);
        let gains: Vec<f64> = of_channel
            .filter(|ratios| ratios.len() >= SAMPLES_MIN)
            .filter_map(|ratios| median(ratios.clone()))
            .collect();
        if gains.len() >= 2 {
            let mean = gains.iter().sum::<f64>() / gains.len() as f64;
            square += gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>();
            known += gains.len();
        }
    }
    (known > 0).then(|| (square / known as f64).sqrt())
}

/// Logarithms of the levels that `view` shows at the centres of Gaussians over those of the Gaussians.
fn ratios(parameters: &Parameters<f32>, each: usize, view: &TrainingView) -> [Vec<f64>; 3] {
    let mut ratios: [Vec<f64>; 3] = Default::default();
    for row in 0..parameters.len() {
        if parameters.tau.get(row).is_some_and(|tau| (f64::from(*tau) - view.time).abs() > 0.5) {
            continue;
        }
        let Some(pixel) = view.pixel_of(parameters.centers[row].map(f64::from)) else { continue };
        if !view.photograph.is_subject(pixel) {
            continue;
        }
        for (channel, ratios) in ratios.iter_mut().enumerate() {
            let level = 255.0 * (0.5 + SH_C0 * f64::from(parameters.sh[row * each][channel]));
            let taken = f64::from(view.photograph.pixels[pixel][channel]);
            if level >= DARKEST && taken >= DARKEST {
                ratios.push(libm::log(taken / level));
            }
        }
    }
    ratios
}

#[cfg(test)]
mod tests {
    use codec::Camera;

    use super::*;
    use crate::fit::views::Photograph;

    /// A wall of Gaussians of one gray, and photographs of it by cameras with these gains; the left third of the picture
    /// shows something else in front.
    fn disagreement(gains: &[f64]) -> Option<f64> {
        let at = |i: usize| [(i % 40) as f32 * 0.05 - 1.0, (i / 40) as f32 * 0.05 - 1.0, 0.0];
        let parameters = Parameters {
            centers: (0..1600).map(at).collect(),
            sh: vec![[0.0; 3]; 1600],
            ..Parameters::default()
        };
        let view = |(camera_id, gain): (usize, &f64)| {
            let position = [0.3 * camera_id as f64, 0.0, -3.0];
            let camera = Camera::look_at(position, [0.0; 3], [0.0, -1.0, 0.0], 0.8, 60, 60);
            let level = (127.5 * gain).round() as u8;
            let pixel = |i: usize| if i % 60 < 20 { [250, 40, 90, 255] } else { [level, level, level, 255] };
            let photograph = Photograph {
                width: 60,
                height: 60,
                pixels: (0..3600).map(pixel).collect(),
                valid: Vec::new(),
            };
            TrainingView { camera_id, camera, time: 0.0, photograph }
        };
        let views: Vec<TrainingView> = gains.iter().enumerate().map(view).collect();
        color_disagreement(&parameters, &views.iter().collect::<Vec<_>>())
    }

    #[test]
    fn the_spread_of_the_gains_is_found() {
        assert!(disagreement(&[1.0; 4]).unwrap() < 1e-9);
        let found = disagreement(&[0.8, 1.0, 1.0, 1.25]).unwrap();
        let expected = (0.5f64).sqrt() * 1.25f64.ln();
        assert!((found - expected).abs() < 0.01, "{found} for {expected}");
    }

    #[test]
    fn one_camera_agrees_with_nobody() {
        assert_eq!(disagreement(&[1.0]), None);
        assert_eq!(color_disagreement(&Parameters::default(), &[]), None);
    }
}
