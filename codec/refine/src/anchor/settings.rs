//! [`AnchorSettings`] and the choices in it.

use codec::PixelFilter;
use serde::{Deserialize, Serialize};

use super::align::Alignment;
use super::hull::HullSettings;
use super::sweep::SweepSettings;

/// Settings of [`anchor`](super::anchor).
#[derive(Clone, Debug, PartialEq)]
pub struct AnchorSettings {
    /// Cameras that put Gaussians on their rays, by [`AnchorView::camera_id`](super::AnchorView);
    /// `None` for all. The paper uses the frontal ones. The others still carve the hull and take part
    /// in the sweep.
    pub views: Option<Vec<usize>>,
    /// Target number of Gaussians in all frames together, mirrored ones included. The result has about
    /// as many, or fewer where the subject has too few pixels.
    pub gaussians: usize,
    /// Source of the depths.
    pub source: DepthSource,
    /// Whether mirror symmetry fills in the back side.
    pub mirror: Mirror,
    /// Settings of the visual hull.
    pub hull: HullSettings,
    /// Settings of the plane sweep.
    pub sweep: SweepSettings,
    /// Temporal width (standard deviation) of the Gaussians, in intervals (see [`Timeline`](crate::fit::Timeline)).
    /// The paper's is 1.5 frames of the capture, and it holds out every other frame: 0.75 intervals. Twice as wide, a
    /// Gaussian learns from more photographs, and halfway between two of them it still has 0.95 of its opacity.
    pub width: f64,
    /// The filter that the Gaussians are drawn with.
    pub filter: PixelFilter,
    /// Depth from which on they are drawn whole, [`codec::Field::near`].
    pub near: f64,
    /// Degree of the spherical harmonics, 0 to 3; all coefficients above degree 0 start at 0.
    pub sh_degree: u8,
    /// Highest power of time in the trajectories, 0 to 3.
    pub motion_order: u8,
    /// Whether trajectories start along the motion of the surface between frames; else all coefficients start at 0.
    pub motion_start: bool,
}

impl Default for AnchorSettings {
    fn default() -> AnchorSettings {
        AnchorSettings {
            views: None,
            gaussians: 200_000,
            source: DepthSource::HullAndSweep,
            mirror: Mirror::Auto,
            hull: HullSettings::default(),
            sweep: SweepSettings::default(),
            width: 1.5,
            filter: PixelFilter::Mip,
            near: 0.0,
            sh_degree: 3,
            motion_order: 3,
            motion_start: true,
        }
    }
}

/// Source of the depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthSource {
    /// Where rays enter the visual hull of the masks.
    Hull,
    /// The hull's depths, refined by a plane sweep over the photographs. Of photographs without masks, a plane sweep
    /// through all the space in front of the cameras.
    HullAndSweep,
    /// The maps in [`AnchorView::depths`](super::AnchorView), after alignment.
    Given(Alignment),
}

/// Most frames of a clip that [`Mirror::Auto`] mirrors: the paper's short clip has nine.
const SHORT: usize = 9;

/// When to mirror the back side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mirror {
    /// In clips of at most nine frames where [`AnchorSettings::views`] names cameras that are all on
    /// one side. Longer clips show the back, and so do cameras all around.
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

impl Mirror {
    /// Whether a clip of this many frames may be mirrored; `has_views` says whether [`AnchorSettings::views`]
    /// names cameras.
    pub fn is_possible(self, frames: usize, has_views: bool) -> bool {
        match self {
            Mirror::Auto => frames <= SHORT && has_views,
            Mirror::On => true,
            Mirror::Off => false,
        }
    }
}
