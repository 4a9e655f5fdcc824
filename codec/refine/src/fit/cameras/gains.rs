//! [`CameraGains`]: by how much cameras show the same surfaces in other colours.
//!
//! Gaussians of an anchor have the colours that some cameras show at their centres. The other cameras show them, or what
//! is in front, in theirs. The median of the ratios over many Gaussians is what a camera does to colours: occlusion and
//! texture put as many above it as below.

use codec::{SH_C0, sh_coefficients};
use rayon::prelude::*;

use crate::capture::Response;
use crate::fit::parameters::Parameters;
use crate::fit::views::TrainingView;
use crate::median::median;

/// Darkest level of a Gaussian that is compared, of 255: the ratios to darker ones are noise.
const DARKEST: f64 = 25.0;

/// Fewest Gaussians that tell the gain of a camera.
const SAMPLES_MIN: usize = 64;

/// Distance in pixels from the middle of a pixel within which a Gaussian was made of it.
const MADE_OF: f64 = 0.01;

/// The gain of each camera, by colour channel.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraGains {
    /// Logarithms over the median camera, by number of the camera; `None` for one that shows too few Gaussians.
    logs: Vec<[Option<f64>; 3]>,
}

impl CameraGains {
    /// The gains of the cameras of `views`. `parameters` are Gaussians on the surfaces that the views show.
    pub fn measure(parameters: &Parameters<f32>, views: &[&TrainingView]) -> CameraGains {
        let each = sh_coefficients(parameters.sh_degree);
        let ratios: Vec<(usize, [Vec<f64>; 3])> =
            views.par_iter().map(|view| (view.camera_id, ratios(parameters, each, view))).collect();
        let cameras = views.iter().map(|view| view.camera_id + 1).max().unwrap_or(0);
        let mut by_camera: Vec<[Vec<f64>; 3]> = vec![Default::default(); cameras];
        for (camera, ratios) in ratios {
            by_camera[camera].iter_mut().zip(ratios).for_each(|(all, ratios)| all.extend(ratios));
        }
        let log = |ratios: Vec<f64>| median(ratios.clone()).filter(|_| ratios.len() >= SAMPLES_MIN);
        let mut logs: Vec<[Option<f64>; 3]> =
            by_camera.into_iter().map(|channels| channels.map(log)).collect();
        for channel in 0..3 {
            let known: Vec<f64> = logs.iter().filter_map(|logs| logs[channel]).collect();
            // One camera of another white balance does not tint the field.
            let Some(middle) = median(known) else { continue };
            logs.iter_mut().filter_map(|logs| logs[channel].as_mut()).for_each(|log| *log -= middle);
        }
        CameraGains { logs }
    }

    /// Root mean square of the logarithms of the gains: 0 for cameras that agree, 0.1 for some that differ by a tenth.
    /// `None` if fewer than two cameras are known.
    pub fn disagreement(&self) -> Option<f64> {
        let known: Vec<f64> = self.logs.as_flattened().iter().copied().flatten().collect();
        let squares: f64 = known.iter().map(|log| log * log).sum();
        (known.len() >= 6).then(|| (squares / known.len() as f64).sqrt())
    }

    /// The responses of cameras without any other difference.
    pub fn responses(&self, cameras: usize) -> Vec<Response> {
        let response = |camera: usize| {
            let mut response = Response::NEUTRAL;
            for (channel, log) in self.logs.get(camera).into_iter().flatten().enumerate() {
                response.color[channel][channel] = libm::exp(log.unwrap_or(0.0));
            }
            response
        };
        (0..cameras).map(response).collect()
    }
}

/// Logarithms of the levels that `view` shows at the centres of Gaussians over those of the Gaussians.
fn ratios(parameters: &Parameters<f32>, each: usize, view: &TrainingView) -> [Vec<f64>; 3] {
    let mut ratios: [Vec<f64>; 3] = Default::default();
    for row in 0..parameters.len() {
        if parameters.tau.get(row).is_some_and(|tau| (f64::from(*tau) - view.time).abs() > 0.5) {
            continue;
        }
        let Some(place) = view.place_of(parameters.centers[row].map(f64::from)) else { continue };
        let [x, y] = place.map(|x| x as usize);
        let pixel = y * view.camera.width as usize + x;
        // One that was made of this photograph tells nothing.
        let is_own = place.iter().all(|x| (x.fract() - 0.5).abs() < MADE_OF);
        if is_own || !view.photograph.is_subject(pixel) {
            continue;
        }
        let levels = parameters.sh[row * each].map(|sh| 255.0 * (0.5 + SH_C0 * f64::from(sh)));
        let taken = [0, 1, 2].map(|channel| f64::from(view.photograph.pixels[pixel][channel]));
        for (channel, ratios) in ratios.iter_mut().enumerate() {
            if levels[channel] >= DARKEST {
                ratios.push(libm::log(taken[channel].max(1.0) / levels[channel]));
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

    /// The gains of cameras that have these, from a wall of Gaussians of one gray; the left third of each photograph shows
    /// something else in front.
    fn measured(gains: &[[f64; 3]]) -> CameraGains {
        let at = |i: usize| [(i % 40) as f32 * 0.05 - 1.0, (i / 40) as f32 * 0.05 - 1.0, 0.0];
        let parameters = Parameters {
            centers: (0..1600).map(at).collect(),
            sh: vec![[0.0; 3]; 1600],
            ..Parameters::default()
        };
        let view = |(camera_id, gains): (usize, &[f64; 3])| {
            let position = [0.3 * camera_id as f64, 0.0, -3.0];
            let camera = Camera::look_at(position, [0.0; 3], [0.0, -1.0, 0.0], 0.8, 60, 60);
            let [r, g, b] = gains.map(|gain| (120.0 * gain).round() as u8);
            let pixel = |i: usize| if i % 60 < 20 { [250, 40, 90, 255] } else { [r, g, b, 255] };
            let photograph = Photograph {
                width: 60,
                height: 60,
                pixels: (0..3600).map(pixel).collect(),
                valid: Vec::new(),
            };
            TrainingView { camera_id, camera, time: 0.0, photograph }
        };
        let views: Vec<TrainingView> = gains.iter().enumerate().map(view).collect();
        CameraGains::measure(&parameters, &views.iter().collect::<Vec<_>>())
    }

    #[test]
    fn gains_are_found_by_channel() {
        let alike = measured(&[[1.0; 3]; 4]);
        assert!(alike.disagreement().unwrap() < 1e-9, "{alike:?}");
        let found = measured(&[[0.8; 3], [1.0; 3], [1.0; 3], [1.25; 3]]);
        let expected = (0.5f64).sqrt() * 1.25f64.ln();
        assert!((found.disagreement().unwrap() - expected).abs() < 0.01, "{found:?}");
        let tinted = measured(&[[1.0; 3], [1.5, 1.0, 0.5], [1.0; 3]]).responses(4);
        assert!((tinted[1].color[0][0] - 1.5).abs() < 0.02 && (tinted[1].color[2][2] - 0.5).abs() < 0.02);
        assert!(tinted[0].color[2][2] == 1.0 && tinted[3].is_neutral(), "{tinted:?}");
        let dark = measured(&[[1.0; 3], [0.1, 0.1, 0.0], [1.0; 3]]).responses(3)[1].color;
        assert!((dark[0][0] - 0.1).abs() < 0.01 && dark[2][2] < 0.01, "{dark:?}");
    }

    #[test]
    fn one_camera_agrees_with_nobody() {
        assert_eq!(measured(&[[1.0; 3]]).disagreement(), None);
        assert_eq!(CameraGains::measure(&Parameters::default(), &[]).disagreement(), None);
    }
}
