//! [`RenderSettings`]: choices about how a clip is drawn that may change from frame to frame.

use clap::ValueEnum;

/// How a clip is drawn. The default is what the reference renderer draws.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderSettings {
    /// What the Gaussians are sorted by.
    pub sort: SortOrder,
    /// How far a Gaussian reaches.
    pub cutoff: Cutoff,
    /// How many layers of the clip are drawn, from the most important one; `None` draws all.
    pub layers: Option<usize>,
    /// Gaussians that can add no more than this to an image are left out; 0 draws all. In pixels of
    /// full alpha, as many as they would be in the middle of the image: its edges are stretched.
    pub min_contribution_px: f32,
}

/// What Gaussians are sorted by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SortOrder {
    /// Distance along the view axis, as fields are fitted.
    #[default]
    Depth,
    /// Distance from the eye: does not change when the head turns.
    Radial,
}

/// How far a Gaussian reaches from its centre at most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Cutoff {
    /// To where its alpha falls to 1/255: nothing visible is cut off.
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
    /// The most standard deviations that a Gaussian reaches.
    pub fn radius_max(self) -> f32 {
        match self {
            // Even a full opacity of 1 reaches only sqrt(2 ln 255) = 3.33.
            Cutoff::Exact => 4.0,
            Cutoff::Sqrt8 => 8f32.sqrt(),
            Cutoff::Sqrt5 => 5f32.sqrt(),
        }
    }
}
