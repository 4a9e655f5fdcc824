//! The anchor: Gaussians on the surface that the cameras see, the starting point of a fit (the paper's
//! grounding equation, `eq:ground`).
//!
//! Each photograph gets a depth map, from one of the [`DepthSource`]s, in the units of the cameras.
//! Every sampled pixel of the subject then puts two Gaussians on its ray.
//!
//! ```text
//! photographs -> silhouette -> hull -> sweep -\
//!      photographs without masks -> open sweep --> ground -> mirror -> motion -> Parameters
//!                        given maps -> align -/
//! ```
//!
//! Frames are read one at a time, so memory holds the photographs of one frame only. When all have their Gaussians,
//! the surfaces of neighbouring frames are registered, and each Gaussian starts on the motion of its surface.

mod align;
mod depth_map;
mod error;
mod frame;
mod ground;
mod hull;
mod mirror;
mod motion;
mod open;
mod pinhole;
mod registration;
mod scatter;
mod settings;
mod silhouette;
mod sources;
mod sweep;
#[cfg(test)]
mod test_scene;
#[cfg(test)]
mod tests;

use glam::DVec3;

pub use align::Alignment;
pub use depth_map::DepthMap;
pub use error::AnchorError;
pub use frame::{AnchorFrame, AnchorView};
pub use hull::HullSettings;
pub use scatter::scatter;
pub use settings::{AnchorSettings, DepthSource, Mirror};
pub use sweep::SweepSettings;

use crate::fit::{Parameters, Timeline};
use mirror::Plane;
use motion::{FrameRows, start_motion};
use sources::FrameSurfaces;

/// Anchors the frames that a field is to be fitted to, in the order of time. `timeline` counts all
/// frames of the clip; a clip of one frame gets Gaussians without temporal columns.
///
/// Frames without a surface (masks empty or of one camera only, depth maps empty) are skipped. The
/// result does not depend on the number of threads.
///
/// # Errors
/// Errors of `frames`; an [`AnchorError`] if no frame has a surface, or the settings ask for something
/// that the capture does not provide.
pub fn anchor<E: From<AnchorError>>(
    settings: &AnchorSettings,
    timeline: Timeline,
    frames: impl ExactSizeIterator<Item = Result<AnchorFrame, E>>,
) -> Result<Parameters<f32>, E> {
    let gaussians_per_frame = settings.gaussians as f64 / frames.len().max(1) as f64;
    let mut scale = None;
    let mut all: Option<Parameters<f32>> = None;
    let mut frame_rows = Vec::new();
    let mut first_error = None;
    for frame in frames {
        let frame = frame?;
        match anchor_frame(settings, timeline, &frame, gaussians_per_frame, &mut scale) {
            Ok(gaussians) => {
                let first = all.as_ref().map_or(0, Parameters::len);
                frame_rows.push(FrameRows { time: frame.time, rows: first..first + gaussians.len() });
                match &mut all {
                    None => all = Some(gaussians),
                    Some(all) => all.append(gaussians),
                }
            }
            Err(error) if error.is_of_one_frame() => {
                first_error.get_or_insert(error);
            }
            Err(error) => return Err(error.into()),
        }
    }
    let mut all = all.ok_or_else(|| first_error.unwrap_or(AnchorError::NoFrames))?;
    if settings.motion_start {
        start_motion(&mut all, &frame_rows);
    }
    Ok(all)
}

/// Depth maps of the views of a frame, from its visual hull: where the ray of each pixel of the subject enters that.
///
/// # Errors
/// An [`AnchorError`] if a photograph has another size than its camera, or the frame has no hull.
pub fn hull_depths(frame: &AnchorFrame, settings: HullSettings) -> Result<Vec<DepthMap>, AnchorError> {
    sources::hull_depths(frame, settings)
}

/// Anchors one frame. `scale` is the scale of [`Alignment::Rig`], set by the first frame that
/// determines it.
fn anchor_frame(
    settings: &AnchorSettings,
    timeline: Timeline,
    frame: &AnchorFrame,
    gaussians_per_frame: f64,
    scale: &mut Option<f64>,
) -> Result<Parameters<f32>, AnchorError> {
    let front = sources::front(settings, frame);
    let mirrors = settings.mirror.is_possible(timeline.frames, settings.views.is_some())
        && (front.is_some() || settings.mirror == Mirror::On);
    let per_ray = ground::PER_RAY * if mirrors { 2 } else { 1 };
    let rays = gaussians_per_frame / per_ray as f64;
    let FrameSurfaces { surfaces, step, hull_center } = sources::surfaces(settings, frame, rays, scale)?;
    if mirrors && front.is_none() {
        return Err(AnchorError::NoFront);
    }
    let time = (timeline.frames > 1).then_some(frame.time);
    let mut gaussians = surfaces
        .iter()
        .map(|surface| surface.ground(step, surfaces.len(), settings, time))
        .reduce(|mut all, more| {
            all.append(more);
            all
        })
        .unwrap_or_default();
    if gaussians.is_empty() {
        return Err(AnchorError::NoRays);
    }
    if let Some(normal) = front.filter(|_| mirrors) {
        let point = hull_center.unwrap_or_else(|| mean(&gaussians));
        gaussians.append(mirror::mirrored(&gaussians, Plane { point, normal }));
    }
    Ok(gaussians)
}

/// Mean of the centres.
fn mean(gaussians: &Parameters<f32>) -> DVec3 {
    let sum: DVec3 = gaussians.centers.iter().map(|x| DVec3::from_array(x.map(f64::from))).sum();
    sum / gaussians.len() as f64
}
