//! [`DensityRule`] and [`DensityChange`]: how capacity control works, and what it did.

use serde::{Deserialize, Serialize};

/// The fate of Gaussians that have become transparent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DensityRule {
    /// They are pruned down to the capacity floor; others are cloned and split.
    #[default]
    Floor,
    /// The same, and all opacities are reset every 3000 steps, as in 3D Gaussian Splatting, whose schedule the
    /// paper's is.
    Paper,
    /// They are relocated to opaque ones; the number of Gaussians never changes.
    Relocate,
    /// They stay, as all do: rows keep their number and their order.
    Fixed,
}

/// The result of one capacity control, or of thinning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensityChange {
    /// Gaussians cloned.
    pub cloned: usize,
    /// Gaussians split in two.
    pub split: usize,
    /// Gaussians pruned: transparent, floating, not finite, or thinned out.
    pub pruned: usize,
    /// Floaters among all Gaussians before pruning.
    pub floaters: usize,
    /// Gaussians that only the capacity floor saved from pruning.
    pub retained: usize,
    /// Gaussians relocated.
    pub relocated: usize,
}
