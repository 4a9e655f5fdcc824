//! [`FieldRd`]: the packages of a field at every budget, measured.

use serde::Serialize;

use super::rates::CoderRate;

/// A way to choose which Gaussians a package keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Selector {
    /// The first by LightGaussian's global significance.
    #[serde(rename = "LightGaussian")]
    LightGaussian,
    /// The first by RadSplat's largest blending contribution.
    #[serde(rename = "RadSplat")]
    RadSplat,
    /// The first by visibility mass.
    #[serde(rename = "mass")]
    Mass,
    /// The same with the topology floor, which restores what is gone (the paper's measure).
    #[serde(rename = "mass + floor")]
    MassFloor,
    /// Of all rankings, with and without the topology floor, which also restores what is cut off, the
    /// one whose package reproduces the field best.
    #[serde(rename = "ours")]
    Ours,
}

impl Selector {
    pub(super) const ALL: [Selector; 5] =
        [Selector::LightGaussian, Selector::RadSplat, Selector::Mass, Selector::MassFloor, Selector::Ours];

    pub(super) fn name(self) -> &'static str {
        match self {
            Selector::LightGaussian => "LightGaussian",
            Selector::RadSplat => "RadSplat",
            Selector::Mass => "mass",
            Selector::MassFloor => "mass + floor",
            Selector::Ours => "ours",
        }
    }
}

/// What was measured of a field.
#[derive(Clone, Debug, Serialize)]
pub struct FieldRd {
    /// The field's name.
    pub field: String,
    /// Number of Gaussians that can be seen, the plate's not counted.
    pub gaussians: usize,
    /// Length of the clip in seconds.
    pub duration_s: f32,
    /// Whether nobody said how long the clip is.
    pub duration_assumed: bool,
    /// How the packages are coded.
    pub coder: &'static str,
    /// Number of persistent features of its density, over all reference instants.
    pub features: usize,
    /// One per budget and row, the largest budget first.
    pub points: Vec<RatePoint>,
    /// What the coder takes for how much precision.
    pub rates: Vec<CoderRate>,
}

/// A package, measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RatePoint {
    /// Gaussians kept.
    pub budget: usize,
    /// The way they were chosen.
    pub row: Selector,
    /// The ranking behind it.
    pub ranking: &'static str,
    /// Gaussians that the floor kept in spite of their rank.
    pub restored: usize,
    /// PSNR in dB of pictures of the decoded package against pictures of the field, over all pixels
    /// of all pictures.
    pub psnr_db: f64,
    /// Part of the features that is preserved: the paper's rate.
    pub recall: f64,
    /// Part of what is found that is a feature of the field; the rest are pieces cut off.
    pub precision: f64,
    /// Harmonic mean of both.
    pub f1: f64,
    /// Mean change of the density at which a preserved feature ends, in units of the largest.
    pub saddle_drift: f64,
    /// Rate of a stream that brings the package while the clip plays once.
    pub mbps: f64,
    /// Size of the package.
    pub bytes: usize,
    /// The same per Gaussian, the plate's not counted.
    pub bytes_per_gaussian: f64,
}
