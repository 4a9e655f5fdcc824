//! [`RenderSettings`]: per-frame settings of the renderer.

use clap::ValueEnum;

/// Per-frame settings. With the defaults, the picture is the reference renderer's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderSettings {
    /// Sort key of the Gaussians.
    pub sort: SortOrder,
    /// Limit of the support radius.
    pub cutoff: Cutoff,
    /// Number of layers to draw, most important first; `None` draws all.
    pub layers: Option<usize>,
    /// Side of the inset as a fraction of the image's sides, above 0 and below 1: the part around the view axis that
    /// is drawn at full resolution. All of the image is drawn at that fraction of the resolution, too. `None` draws
    /// everything at full resolution.
    pub inset: Option<f32>,
}

/// Sort key of Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SortOrder {
    /// Distance along the view axis, as in fitting.
    #[default]
    Depth,
    /// Distance from the eye: invariant to head rotation.
    Radial,
}

/// Limit of the support radius of a Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Cutoff {
    /// No limit: the quad ends where alpha falls to 1/255, so nothing visible is cut off.
    #[default]
    Exact,
    /// `sqrt(8)` standard deviations, as common players do.
    #[value(name = "8")]
    Sqrt8,
    /// `sqrt(5)` standard deviations: a third fewer pixels than `sqrt(8)`.
    #[value(name = "5")]
    Sqrt5,
}

impl Cutoff {
    /// The limit in standard deviations.
    pub fn radius_max(self) -> f32 {
        match self {
            // Above the exact radius of an opacity of 1, sqrt(2 ln 255) = 3.33.
            Cutoff::Exact => 4.0,
            Cutoff::Sqrt8 => 8f32.sqrt(),
            Cutoff::Sqrt5 => 5f32.sqrt(),
        }
    }
}
