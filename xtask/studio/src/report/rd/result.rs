//! [`FieldRd`]: rate and distortion of the packages of a field at every budget.

use serde::Serialize;

use super::rates::CoderRate;

/// How the Gaussians of a package are selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Selector {
    /// Highest global significance (LightGaussian).
    #[serde(rename = "LightGaussian")]
    LightGaussian,
    /// Highest largest blending contribution (RadSplat).
    #[serde(rename = "RadSplat")]
    RadSplat,
    /// Highest visibility mass.
    #[serde(rename = "mass")]
    Mass,
    /// Visibility mass with the topology floor that restores deleted features (the paper's measure).
    #[serde(rename = "mass + floor")]
    MassFloor,
    /// The ranking whose package reproduces the field best, among all rankings with and without the topology
    /// floor that also restores severed features.
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

/// Rate and distortion of a field.
#[derive(Clone, Debug, Serialize)]
pub struct FieldRd {
    /// The field's name.
    pub field: String,
    /// Number of visible Gaussians, without the plate's.
    pub gaussians: usize,
    /// Length of the clip in seconds.
    pub duration_s: f32,
    /// Whether the source lacks a duration, so that `duration_s` is assumed.
    pub duration_assumed: bool,
    /// Name of the packages' coder.
    pub coder: &'static str,
    /// Number of persistent features of the field's density, over all reference instants.
    pub features: usize,
    /// Width and height in pixels of the images in which packages are compared with the field.
    pub image_size: [u32; 2],
    /// One point per budget and selector, the largest budget first.
    pub points: Vec<RatePoint>,
    /// Width and height in pixels of the images of [`FieldRd::rates`].
    pub rate_image_size: [u32; 2],
    /// Rate of the coder over its precision.
    pub rates: Vec<CoderRate>,
}

/// Rate and distortion of one package.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RatePoint {
    /// Number of Gaussians in the package.
    pub budget: usize,
    /// How they were selected.
    pub row: Selector,
    /// Name of the selector's ranking.
    pub ranking: &'static str,
    /// Number of Gaussians that the floor restored in spite of their rank.
    pub restored: usize,
    /// PSNR in dB of images of the decoded package against images of the field, over all pixels of all
    /// images.
    pub psnr_db: f64,
    /// Fraction of the field's features that the package preserves: the paper's rate.
    pub recall: f64,
    /// Fraction of the package's features that are features of the field; the others are severed pieces.
    pub precision: f64,
    /// Harmonic mean of recall and precision.
    pub f1: f64,
    /// Mean change of the density at which a preserved feature ends, as a fraction of the largest density.
    pub saddle_drift: f64,
    /// Bit rate in Mbit/s of streaming the package in the duration of the clip.
    pub mbps: f64,
    /// Size of the package in bytes.
    pub bytes: usize,
    /// Bytes per Gaussian, without counting the plate's Gaussians.
    pub bytes_per_gaussian: f64,
}
