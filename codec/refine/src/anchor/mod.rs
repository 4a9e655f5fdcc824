//! The anchor: Gaussians on the surface that the cameras see, which refinement starts from.
//!
//! Depths per photograph, from whichever source there is, are brought to the scale of the cameras;
//! every pixel of the subject puts Gaussians on its ray (the paper's grounding equation).
//!
//! ```text
//! photographs -> silhouette -> hull -> sweep -\
//!                        given maps -> align --> ground -> mirror -> Parameters
//! ```
//!
//! Frames come one at a time, so that memory is that of one frame's photographs.

mod align;
mod depth_map;
mod error;
mod eye;
mod ground;
mod hull;
mod mirror;
mod scatter;
#[cfg(test)]
mod scene;
mod silhouette;
mod sources;
mod sweep;
#[cfg(test)]
mod tests;

use codec::Camera;
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use align::Alignment;
pub use depth_map::DepthMap;
pub use error::AnchorError;
pub use hull::HullSettings;
pub use scatter::scatter;
pub use sweep::SweepSettings;

use crate::fit::{Parameters, Photograph, Timeline};
use ground::Surface;
use mirror::Plane;

/// Most frames of a clip for the back side to be mirrored by itself: the paper's short clip has nine.
const SHORT: usize = 9;

/// What an anchor is to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Anchor {
    /// The cameras that put Gaussians on their rays, by [`AnchorView::camera_id`]; `None` for all.
    /// The paper's are the frontal ones. The others still carve the hull and are swept against.
    pub views: Option<Vec<usize>>,
    /// Number of Gaussians wanted, in all frames together, mirrored ones included. There are about as
    /// many, fewer where the subject has not enough pixels.
    pub gaussians: usize,
    /// Where depths come from.
    pub source: Source,
    /// Whether the back side is filled by mirror symmetry.
    pub mirror: Mirror,
    /// How the hull is carved.
    pub hull: HullSettings,
    /// How depths are swept.
    pub sweep: SweepSettings,
    /// Width of the Gaussians' windows in frames of the capture. The paper's scale of 1.5 is taken to
    /// count these, not the spacing of the training frames: of two training frames with one held out
    /// between them, a Gaussian of either has 0.80 of its opacity there.
    pub width: f64,
    /// Degree of the spherical harmonics; all but the constant one start at 0.
    pub sh_degree: u8,
    /// Highest power of time in the trajectories; all but the first start at 0.
    pub motion_order: u8,
}

impl Default for Anchor {
    fn default() -> Anchor {
        Anchor {
            views: None,
            gaussians: 200_000,
            source: Source::HullAndSweep,
            mirror: Mirror::Auto,
            hull: HullSettings::default(),
            sweep: SweepSettings::default(),
            width: 1.5,
            sh_degree: 3,
            motion_order: 3,
        }
    }
}

/// Where depths come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Where rays enter the visual hull of the masks.
    Hull,
    /// The same, moved inwards to where the photographs agree.
    HullAndSweep,
    /// [`AnchorView::depths`].
    Given(Alignment),
}

/// When the back side is mirrored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mirror {
    /// In clips of at most nine frames where [`Anchor::views`] names cameras, all on one side: more
    /// frames show the back, cameras all around see it.
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

/// A frame of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct AnchorFrame {
    /// Number of the frame in the clip, held ones counted, from 0.
    pub frame: usize,
    /// What cameras saw of it.
    pub views: Vec<AnchorView>,
}

/// What a camera saw of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct AnchorView {
    /// Number of the camera in the capture.
    pub camera_id: usize,
    /// The camera, at the size of the photograph. It satisfies [`Camera::check`].
    pub camera: Camera,
    /// The photograph.
    pub photograph: Photograph,
    /// Its depths, for [`Source::Given`].
    pub depths: Option<DepthMap>,
}

/// The anchor of the frames that a field is to be fitted to, in the order of time; `timeline` counts all
/// frames of the clip. A clip of one frame gets Gaussians without time.
///
/// Frames in which no surface is found (masks are empty, or of one camera only; depth maps hold
/// nothing) are passed over. The result does not depend on the number of threads.
///
/// # Errors
/// Those of `frames`; an [`AnchorError`] where no frame has a surface, or the settings ask for what
/// the capture cannot give.
pub fn anchor<E: From<AnchorError>>(
    settings: &Anchor,
    timeline: Timeline,
    frames: impl ExactSizeIterator<Item = Result<AnchorFrame, E>>,
) -> Result<Parameters<f32>, E> {
    let gaussians_of_frame = settings.gaussians as f64 / frames.len().max(1) as f64;
    let mut scale = None;
    let mut all: Option<Parameters<f32>> = None;
    let mut fault = AnchorError::NoFrames;
    for frame in frames {
        let frame = frame?;
        let front = sources::front(settings, &frame);
        let mirrors = match settings.mirror {
            Mirror::Off => false,
            Mirror::Auto => timeline.frames <= SHORT && settings.views.is_some() && front.is_some(),
            Mirror::On => true,
        };
        let per_ray = ground::PER_RAY * if mirrors { 2 } else { 1 };
        let rays = gaussians_of_frame / per_ray as f64;
        let Found { surfaces, step, middle } = match sources::surfaces(settings, &frame, rays, &mut scale) {
            Ok(found) => found,
            Err(error) if error.is_of_one_frame() => {
                // The first says why, should all fail.
                if fault == AnchorError::NoFrames {
                    fault = error;
                }
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        if mirrors && front.is_none() {
            return Err(AnchorError::NoFront.into());
        }
        let normal = front.filter(|_| mirrors);
        let time = (timeline.frames > 1).then_some(frame.frame);
        let gaussians = surfaces
            .iter()
            .map(|surface| surface.ground(step, surfaces.len(), settings, time))
            .reduce(|mut all, more| {
                all.append(more);
                all
            })
            .unwrap_or_default();
        if gaussians.is_empty() {
            if fault == AnchorError::NoFrames {
                fault = AnchorError::NoRays;
            }
            continue;
        }
        let plane = normal.map(|normal| Plane { point: middle.unwrap_or_else(|| mean(&gaussians)), normal });
        let back = plane.map(|plane| mirror::mirrored(&gaussians, plane));
        for part in [Some(gaussians), back].into_iter().flatten() {
            match &mut all {
                None => all = Some(part),
                Some(all) => all.append(part),
            }
        }
    }
    all.ok_or_else(|| fault.into())
}

/// The surface of a frame.
struct Found<'a> {
    surfaces: Vec<Surface<'a>>,
    /// Distance in pixels between the rays that are sampled.
    step: f64,
    /// Middle of the hull, where there is one.
    middle: Option<DVec3>,
}

/// The mean of the centres.
fn mean(gaussians: &Parameters<f32>) -> DVec3 {
    let sum: DVec3 = gaussians.centers.iter().map(|x| DVec3::from_array(x.map(f64::from))).sum();
    sum / gaussians.len() as f64
}
