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

/// Largest logarithm of a gain: beyond a factor of 4, a camera shows something else.
const LOG_MAX: f64 = 1.4;

/// The gain of each camera, by colour channel.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraGains {
    /// Logarithms over the median camera, by number of the camera; `None` for one that shows too few Gaussians.
    logs: Vec<Option<[f64; 3]>>,
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
        let log = |[r, g, b]: [Vec<f64>; 3]| -> Option<[f64; 3]> {
            let is_known = [&r, &g, &b].iter().all(|ratios| ratios.len() >= SAMPLES_MIN);
            is_known.then(|| [median(r), median(g), median(b)].map(|log| log.expect("there are samples")))
        };
        let mut logs: Vec<Option<[f64; 3]>> = by_camera.into_iter().map(log).collect();
        let known = logs.iter().flatten().count() as f64;
        for channel in 0..3 {
            let mut sorted: Vec<f64> = logs.iter().flatten().map(|logs| logs[channel]).collect();
            let Some(last) = sorted.len().checked_sub(1) else { continue };
            sorted.sort_unstable_by(f64::total_cmp);
            // The median: one camera of another white balance does not tint the field.
            let middle = 0.5 * (sorted[last / 2] + sorted[last.div_ceil(2)]);
            for logs in logs.iter_mut().flatten() {
                // Gaussians have the colours of the other cameras: their mean is off by its share of this one.
                logs[channel] = ((logs[channel] - middle) * (known - 1.0) / known).clamp(-LOG_MAX, LOG_MAX);
            }
        }
        CameraGains { logs }
    }

    /// Root mean square of the logarithms of the gains: 0 for cameras that agree, 0.1 for some that differ by a tenth.
    /// `None` if fewer than two cameras are known.
    pub fn disagreement(&self) -> Option<f64> {
        let known: Vec<[f64; 3]> = self.logs.iter().copied().flatten().collect();
        let squares: f64 = known.as_flattened().iter().map(|log| log * log).sum();
        (known.len() >= 2).then(|| (squares / (3 * known.len()) as f64).sqrt())
    }

    /// The responses of cameras without any other difference.
    pub fn responses(&self, cameras: usize) -> Vec<Response> {
        let response = |camera: usize| {
            let mut response = Response::NEUTRAL;
            for (channel, log) in self.logs.get(camera).into_iter().flatten().flatten().enumerate() {
                response.color[channel][channel] = libm::exp(*log);
            }
            response
        };
        (0..cameras).map(response).collect()
    }
}

/// Logarithms of the levels that `view` shows at the centres of Gaussians, divided by the levels of the Gaussians.
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

    /// A wall that cameras with these gains see; the left third of each photograph shows something else in front.
    fn views(gains: &[[f64; 3]]) -> Vec<TrainingView> {
        let view = |(camera_id, gains): (usize, &[f64; 3])| {
            let position = [0.31 * camera_id as f64, 0.0, -3.0];
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
        gains.iter().enumerate().map(view).collect()
    }

    /// Gaussians where the rays of pixels meet the wall, in the colours of their photographs.
    fn grounded(views: &[TrainingView]) -> Parameters<f32> {
        let mut parameters = Parameters::default();
        for view in views {
            let Camera { camera_from_world: m, k, .. } = &view.camera;
            let eye = view.camera.position();
            for pixel in (0..3600).filter(|i| i % 60 >= 20 && i % 7 == 0) {
                let at = [pixel % 60, pixel / 60].map(|x| x as f64 + 0.5);
                let ray = [(at[0] - k[0][2]) / k[0][0], (at[1] - k[1][2]) / k[1][1], 1.0];
                let ray = [0, 1, 2].map(|axis| (0..3).map(|row| m[row][axis] * ray[row]).sum::<f64>());
                let depth = -eye[2] / ray[2];
                parameters.centers.push([0, 1, 2].map(|axis| (eye[axis] + depth * ray[axis]) as f32));
                let [r, g, b, _] = view.photograph.pixels[pixel].map(f64::from);
                parameters.sh.push([r, g, b].map(|c| ((c / 255.0 - 0.5) / SH_C0) as f32));
            }
        }
        parameters
    }

    fn measured(gains: &[[f64; 3]]) -> CameraGains {
        let views = views(gains);
        CameraGains::measure(&grounded(&views), &views.iter().collect::<Vec<_>>())
    }

    #[test]
    fn gains_are_found_by_channel() {
        let alike = measured(&[[1.0; 3]; 4]);
        assert!(alike.disagreement().unwrap() < 1e-9, "{alike:?}");
        let two = measured(&[[0.8; 3], [1.25; 3]]).responses(2);
        let two = [0, 1].map(|camera: usize| two[camera].color[1][1]);
        assert!((two[1] / two[0] - 1.25 / 0.8).abs() < 0.02, "{two:?}");
        let tinted =
            measured(&[[1.0; 3], [1.5, 1.0, 0.5], [1.0; 3], [1.0; 3], [1.0; 3], [1.0; 3]]).responses(7);
        let [r, g, b] = [0, 1, 2].map(|c| tinted[1].color[c][c] / tinted[0].color[c][c]);
        assert!((r - 1.5).abs() < 0.15 && (g - 1.0).abs() < 0.01 && (b - 0.5).abs() < 0.1, "{r} {g} {b}");
        assert!(tinted[6].is_neutral(), "a camera without views");
        let dark = measured(&[[1.0; 3], [0.05; 3], [1.0; 3], [1.0; 3]]).responses(4)[1].color[0][0];
        assert!((dark - libm::exp(-LOG_MAX)).abs() < 1e-9, "{dark}");
    }

    /// Its own Gaussians would say that a camera is like the field.
    #[test]
    fn gaussians_do_not_vote_on_the_camera_that_they_were_made_of() {
        let views = views(&[[1.0; 3], [0.7; 3]]);
        let own = grounded(&views[..1]);
        assert!(ratios(&own, 1, &views[0])[0].is_empty());
        let other = ratios(&own, 1, &views[1]);
        assert!(other[0].len() > 100);
    }

    #[test]
    fn one_camera_agrees_with_nobody() {
        assert_eq!(measured(&[[1.0; 3]]).disagreement(), None);
        assert_eq!(CameraGains::measure(&Parameters::default(), &[]).disagreement(), None);
    }
}
