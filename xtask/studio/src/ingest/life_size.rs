//! [`metres_per_unit`]: how large a unit of the calibration is, by the height of the subject, who stands upright at the start.
//!
//! The visual hulls of the first frames are measured along the up direction.

use codec::Camera;
use glam::DVec3;
use program::Fault;
use refine::anchor::{AnchorError, AnchorFrame, AnchorSettings, AnchorView, DepthSource, Mirror, anchor};
use refine::capture::PhotoId;
use refine::fit::{Photograph, Timeline};

use crate::capture::CaptureFiles;

/// Number of frames from the first on. The median of these frames counts.
const FRAMES: usize = 5;

/// Share of the points of a hull, at the top and at the bottom, that do not count: pixels of a matte that are wrong.
const STRAYS: f64 = 0.002;

/// Points of a hull: at most so many of its pixels are sampled.
const POINTS: usize = 40_000;

/// Metres per unit if the subject of the capture is `height_m` tall; `up` has length 1.
///
/// # Errors
/// [`Fault::Data`] if a photograph cannot be read, or the first frames show no subject in two cameras.
pub(super) fn metres_per_unit(
    capture_files: &CaptureFiles,
    up: [f64; 3],
    height_m: f64,
) -> Result<f64, Fault> {
    let mut heights = Vec::new();
    let mut problem = AnchorError::NoFrames;
    for frame in 0..FRAMES.min(capture_files.capture.frames()) {
        match height(views(capture_files, frame)?, DVec3::from(up)) {
            Ok(height) => heights.push(height),
            Err(error) => problem = error,
        }
    }
    heights.sort_by(f64::total_cmp);
    match heights.get(heights.len() / 2).filter(|height| **height > 0.0) {
        Some(height) => Ok(height_m / height),
        None => Err(Fault::Data(format!(
            "--height {height_m}: the subject cannot be measured at the start: {problem}; look at its masks, or state \
             --metres-per-unit"
        ))),
    }
}

/// The photographs of a frame.
fn views(capture_files: &CaptureFiles, frame: usize) -> Result<Vec<AnchorView>, Fault> {
    let of_frame = capture_files.capture.photos.iter().filter(|photo_id| photo_id.frame == frame);
    let view = |&photo_id: &PhotoId| {
        let photograph = Photograph::from(&capture_files.photo(photo_id)?);
        let camera: Camera = capture_files.capture.cameras[photo_id.camera].camera.clone();
        Ok(AnchorView { camera_id: photo_id.camera, camera, photograph, depths: None })
    };
    of_frame.map(view).collect()
}

/// Height of the hull of a frame, in units.
fn height(views: Vec<AnchorView>, up: DVec3) -> Result<f64, AnchorError> {
    let settings = AnchorSettings {
        source: DepthSource::Hull,
        gaussians: POINTS,
        mirror: Mirror::Off,
        motion_start: false,
        sh_degree: 0,
        ..AnchorSettings::default()
    };
    let frame = AnchorFrame { frame: 0, time: 0.0, views };
    let points = anchor(&settings, Timeline::even(1), [Ok::<_, AnchorError>(frame)].into_iter())?;
    let mut along: Vec<f64> =
        points.centers.iter().map(|center| up.dot(DVec3::from(center.map(f64::from)))).collect();
    along.sort_by(f64::total_cmp);
    let stray = (STRAYS * along.len() as f64) as usize;
    Ok(along[along.len() - 1 - stray] - along[stray])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four cameras see a post of 0.2 by 1.6 by 0.2 at 4: as its near sides are at 3.9, their hull is 1.56 high.
    #[test]
    fn a_post_is_as_high_as_it_is() {
        let view = |i: usize| {
            let (sin, cos) = libm::sincos(0.5 * std::f64::consts::PI * i as f64);
            let camera =
                Camera::look_at([4.0 * sin, 0.8, 4.0 * cos], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0], 0.8, 192, 192);
            let mut photograph =
                Photograph { width: 192, height: 192, pixels: vec![[0; 4]; 192 * 192], valid: Vec::new() };
            let focal = camera.k[1][1];
            for (pixel, color) in photograph.pixels.iter_mut().enumerate() {
                let [x, y] = [pixel % 192, pixel / 192].map(|at| (at as f64 - 95.5) / focal);
                if (4.0 * x).abs() < 0.1 && (4.0 * y).abs() < 0.8 {
                    *color = [200, 200, 200, 255];
                }
            }
            AnchorView { camera_id: i, camera, photograph, depths: None }
        };
        let found = height((0..4).map(view).collect(), DVec3::Y).unwrap();
        assert!((found - 1.56).abs() < 0.04, "{found}");
        let lying = height((0..4).map(view).collect(), DVec3::X).unwrap();
        assert!(lying < 0.4, "{lying}");
        assert_eq!(height(vec![view(0)], DVec3::Y), Err(AnchorError::OneView));
    }
}
