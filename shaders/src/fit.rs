//! The stages of a fit: compute shaders that render Gaussians, compare the image with a photograph,
//! backpropagate the loss and take a step of Adam.
//!
//! ```text
//! project -> sort -> bin -> rasterize -> loss -> rasterize_backward -> project_backward -> sum, adam
//! ```
//!
//! [`compose`] assembles a stage for the columns of a scene; absent columns cost neither memory nor
//! code. A stage has one or more kernels ([`Stage::kernels`]). All bindings are in group 0, and a buffer
//! has the same number in every stage ([`binding`]). No kernel binds more than eight storage buffers, the
//! number that every device supports.

pub mod layout;
#[cfg(test)]
mod tests;

use crate::{ALPHA_MAX, ALPHA_MIN, FADE_START, filter_variance};

/// A pixel is saturated before the fragment that would lower its transmittance to this.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Side of a tile in pixels.
pub const TILE: u32 = 16;
/// A quaternion that is not longer has no direction.
pub const LENGTH_MIN: f32 = 1e-12;
/// Adam's beta1, beta2 and epsilon.
pub const ADAM: [f32; 3] = [0.9, 0.999, 1e-15];
/// Reach of a window in its widths, and the shortest reach in intervals.
pub const REACH: [f32; 2] = [3.0, 1.0];
/// Weight of structural dissimilarity in the loss, against L1.
pub const LAMBDA: f32 = 0.2;

/// Threads per group of most kernels.
pub const GROUP: u32 = 64;
/// Threads per group of a sort, and of the kernels that sum over a group: a thread for each value of a digit.
pub const SUM_GROUP: u32 = DIGITS;
/// Number of values of a digit of [`Stage::Sort`].
pub const DIGITS: u32 = 1 << DIGIT_BITS;
/// Bits per digit.
pub const DIGIT_BITS: u32 = 8;
/// Floats that `rasterize_backward` leaves per splat-tile pair.
pub const SPLAT_NUMBERS: u32 = 9;
/// Number of columns of the parameters: centres, rotations, log-scales, logits, spherical harmonics, `tau`,
/// log-widths, motion, rotation rates.
pub const COLUMNS: usize = 9;
const _: () = assert!(COLUMNS == layout::AdamUniforms::SH_REST as usize);

/// Sort key of a Gaussian that is not drawn.
const NOT_DRAWN: u32 = u32::MAX;
/// Added to the squared Mahalanobis distance at which alpha is 1/255: more than the rounding error of the
/// exponential.
const Q_MARGIN: f32 = 256.0 * f32::EPSILON;
/// Size and standard deviation of the window of SSIM in pixels.
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;

/// Binding numbers in group 0.
pub mod binding {
    /// [`StepUniforms`](super::layout::StepUniforms).
    pub const UNIFORMS: u32 = 0;
    /// [`Series`](super::layout::Series).
    pub const SERIES: u32 = 1;
    /// [`AdamUniforms`](super::layout::AdamUniforms).
    pub const ADAM_UNIFORMS: u32 = 2;
    /// [`Totals`](super::layout::Totals).
    pub const TOTALS: u32 = 3;
    /// The columns, one after the other: `f32`.
    pub const PARAMETERS: u32 = 4;
    /// One splat of [`SPLAT_BYTES`](super::SPLAT_BYTES) per Gaussian.
    pub const SPLATS: u32 = 5;
    /// Sort keys: `u32`.
    pub const KEYS: u32 = 6;
    /// Values of the keys: `u32`.
    pub const ROWS: u32 = 7;
    /// [`KEYS`], sorted.
    pub const SORTED_KEYS: u32 = 8;
    /// [`ROWS`], sorted.
    pub const SORTED_ROWS: u32 = 9;
    /// Number of keys with each digit in each part of a series: `u32`.
    pub const COUNTS: u32 = 10;
    /// Tiles of each block of drawn splats: `u32`.
    pub const BLOCK_SUMS: u32 = 11;
    /// Rows of the drawn splats, front to back: `u32`.
    pub const ORDER: u32 = 12;
    /// Index of the first pair of each tile, and the end of the last tile: `u32`.
    pub const TILE_STARTS: u32 = 13;
    /// Red, green, blue over black, and alpha: 4 `f32` per pixel.
    pub const IMAGE: u32 = 14;
    /// Red, green, blue and validity, a byte each: `u32` per pixel.
    pub const PHOTOGRAPH: u32 = 15;
    /// Sums over the pixels of a tile: [`TILE_NUMBERS`](super::TILE_NUMBERS) `f32` each.
    pub const TILE_SUMS: u32 = 16;
    /// Derivatives of SSIM with respect to the moments: 9 `f32` per pixel.
    pub const DERIVATIVES: u32 = 17;
    /// Gradient with respect to the view, by [`GROUP`](super::GROUP) drawn Gaussians: [`VIEW_BYTES`](super::VIEW_BYTES) each.
    pub const VIEW_SUMS: u32 = 18;
    /// Gradient with respect to the image: 4 `f32` per pixel.
    pub const D_IMAGE: u32 = 19;
    /// Gradient sums: [`SPLAT_NUMBERS`](super::SPLAT_NUMBERS) `f32` per splat-tile pair.
    pub const D_PAIRS: u32 = 20;
    /// Gradient with respect to the parameters of the drawn Gaussians, in columns like [`PARAMETERS`].
    pub const D_PARAMETERS: u32 = 21;
    /// [`Statistics`](super::layout::Statistics) per Gaussian.
    pub const STATISTICS: u32 = 22;
    /// Adam's first moments, in columns like [`PARAMETERS`].
    pub const FIRST_MOMENTS: u32 = 23;
    /// Adam's second moments, in columns like [`PARAMETERS`].
    pub const SECOND_MOMENTS: u32 = 24;
    /// Tile of each splat-tile pair: `u32`.
    pub const PAIR_TILES: u32 = 25;
    /// Row of the splat of each pair: `u32`.
    pub const PAIR_ROWS: u32 = 26;
    /// Indices of the pairs, sorted by tile and front to back: `u32`.
    pub const TILE_PAIRS: u32 = 27;
    /// [`Response`](super::layout::Response).
    pub const RESPONSE: u32 = 28;
    /// Gradient with respect to the camera: [`CAMERA_NUMBERS`](super::CAMERA_NUMBERS) `f32`.
    pub const D_CAMERA: u32 = 29;
}

/// Size in bytes of a gradient with respect to the view.
pub const VIEW_BYTES: u64 = 32;

/// Numbers of a camera that are learned: time, rotation, translation, logarithm of the focal lengths, colours, vignette.
pub const CAMERA_NUMBERS: usize = 21;

/// Numbers of [`binding::TILE_SUMS`] per tile: absolute difference, similarity, gradient with respect to the response.
pub const TILE_NUMBERS: u32 = 15;

/// Size of a splat in bytes.
pub const SPLAT_BYTES: u64 = 64;

/// The columns of a scene, and its filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns {
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Whether Gaussians have temporal windows.
    pub is_timed: bool,
    /// Highest power of time in the trajectories, 0 to 3.
    pub motion_order: u8,
    /// Whether Gaussians rotate.
    pub rotates: bool,
    /// Whether the scene has the mip filter, which compensates opacities.
    pub mip: bool,
}

impl Columns {
    /// Floats per Gaussian in each column.
    pub fn counts(self) -> [u32; COLUMNS] {
        let timed = u32::from(self.is_timed);
        let rate = if self.rotates { 4 } else { 0 };
        [3, 4, 3, 1, 3 * self.harmonics(), timed, timed, 3 * u32::from(self.motion_order), rate]
    }

    /// Floats per Gaussian.
    pub fn numbers(self) -> u32 {
        self.counts().iter().sum()
    }

    fn harmonics(self) -> u32 {
        (u32::from(self.sh_degree) + 1).pow(2)
    }
}

/// A stage, that is a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Projects Gaussians to splats.
    Project,
    /// One pass of a radix sort.
    Sort,
    /// Lists the splat-tile pairs.
    Bin,
    /// Composites splats into pixels.
    Rasterize,
    /// Compares the image, as the camera shows it, with the photograph.
    Loss,
    /// Backpropagates from pixels to splats.
    RasterizeBackward,
    /// Backpropagates from splats to parameters.
    ProjectBackward,
    /// Sums the loss and the gradient with respect to the camera.
    Sum,
    /// Moves the parameters along the gradient.
    Adam,
}

impl Stage {
    /// All stages.
    pub const ALL: [Stage; 9] = [
        Stage::Project,
        Stage::Sort,
        Stage::Bin,
        Stage::Rasterize,
        Stage::Loss,
        Stage::RasterizeBackward,
        Stage::ProjectBackward,
        Stage::Sum,
        Stage::Adam,
    ];

    /// Names of the entry points.
    pub fn kernels(self) -> &'static [&'static str] {
        match self {
            Stage::Project => &["project"],
            Stage::Sort => &["count_digits", "scatter"],
            Stage::Bin => &["count_tiles", "list_pairs", "find_tiles"],
            Stage::Rasterize => &["rasterize"],
            Stage::Loss => &["compare", "loss_backward"],
            Stage::RasterizeBackward => &["rasterize_backward"],
            Stage::ProjectBackward => &["project_backward"],
            Stage::Sum => &["sum_step"],
            Stage::Adam => &["adam"],
        }
    }
}

/// WGSL source of a stage for a scene with `columns`.
pub fn compose(stage: Stage, columns: Columns) -> String {
    let thread = include_str!("../fit/thread.wgsl");
    let uniforms = include_str!("../fit/uniforms.wgsl");
    let splat = include_str!("../fit/splat.wgsl");
    let places = include_str!("../fit/columns.wgsl");
    let parameters = include_str!("../fit/parameters.wgsl");
    let harmonics = include_str!("../fit/harmonics.wgsl");
    let near = include_str!("../near.wgsl");
    let projection = include_str!("../fit/projection.wgsl");
    let ellipse = include_str!("../fit/ellipse.wgsl");
    let footprint = include_str!("../fit/footprint.wgsl");
    let group_sum = include_str!("../fit/group_sum.wgsl");
    let statistics = include_str!("../fit/statistics.wgsl");
    let view_gradient = include_str!("../fit/view_gradient.wgsl");
    let parts: &[&str] = match stage {
        Stage::Project => {
            let project = include_str!("../fit/project.wgsl");
            &[uniforms, splat, places, parameters, harmonics, near, projection, ellipse, statistics, project]
        }
        Stage::Sort => &[group_sum, include_str!("../fit/sort.wgsl")],
        Stage::Bin => &[uniforms, splat, ellipse, group_sum, include_str!("../fit/bin.wgsl")],
        Stage::Rasterize => &[uniforms, splat, footprint, include_str!("../fit/rasterize.wgsl")],
        Stage::Loss => &[uniforms, include_str!("../fit/response.wgsl"), include_str!("../fit/loss.wgsl")],
        Stage::RasterizeBackward => {
            &[uniforms, splat, footprint, include_str!("../fit/rasterize_backward.wgsl")]
        }
        Stage::ProjectBackward => {
            let project_backward = include_str!("../fit/project_backward.wgsl");
            let splats = [uniforms, splat, places, parameters, harmonics, near, projection, statistics];
            &[&splats[..], &[view_gradient, project_backward]].concat()
        }
        Stage::Sum => &[uniforms, view_gradient, include_str!("../fit/sum.wgsl")],
        Stage::Adam => &[uniforms, places, statistics, include_str!("../fit/adam.wgsl")],
    };
    constants(columns) + thread + &parts.concat()
}

/// The constants of the shaders.
// Long: one constant a line.
fn constants(columns: Columns) -> String {
    let counts = columns.counts();
    let mut starts = [0; COLUMNS];
    for column in 1..COLUMNS {
        starts[column] = starts[column - 1] + counts[column - 1];
    }
    let unsigned = |(name, value): (&str, u32)| format!("const {name}: u32 = {value}u;\n");
    let float = |(name, value): (&str, f32)| format!("const {name}: f32 = {value:?};\n");
    let truth = |(name, value): (&str, bool)| format!("const {name}: bool = {value};\n");
    let list = |name: &str, kind: &str, values: &[String]| {
        format!("const {name} = array<{kind}, {}>({});\n", values.len(), values.join(", "))
    };
    let [beta1, beta2, epsilon] = ADAM;
    let [support_radius, reach_min] = REACH;
    let log = |beta: f32| f64::from(beta).ln() as f32;
    let mut source: String = [
        ("TILE", TILE),
        ("GROUP", GROUP),
        ("SUM_GROUP", SUM_GROUP),
        ("DIGITS", DIGITS),
        ("NOT_DRAWN", NOT_DRAWN),
        ("TILE_NUMBERS", TILE_NUMBERS),
        ("SPLAT_NUMBERS", SPLAT_NUMBERS),
        ("DRAWN", layout::Totals::DRAWN),
        ("PAIRS", layout::Totals::PAIRS),
        ("NON_FINITE", layout::Totals::NON_FINITE),
        ("ABSOLUTE", layout::Totals::ABSOLUTE),
        ("SIMILARITY", layout::Totals::SIMILARITY),
        ("HALTED", layout::Totals::HALTED),
        ("HARMONICS", columns.harmonics()),
        ("MOTION_ORDER", columns.motion_order.into()),
        ("NUMBERS", columns.numbers()),
        ("COLUMNS", COLUMNS as u32),
        ("SH_REST", layout::AdamUniforms::SH_REST),
    ]
    .map(unsigned)
    .concat();
    source += &[
        ("ALPHA_MIN", ALPHA_MIN),
        ("ALPHA_MAX", ALPHA_MAX),
        ("FADE_START", FADE_START),
        ("FILTER", filter_variance(columns.mip)),
        ("TRANSMITTANCE_MIN", TRANSMITTANCE_MIN),
        ("LENGTH_MIN", LENGTH_MIN),
        ("Q_MARGIN", Q_MARGIN),
        ("LAMBDA", LAMBDA),
        ("BETA1", beta1),
        ("BETA2", beta2),
        ("LOG_BETA1", log(beta1)),
        ("LOG_BETA2", log(beta2)),
        ("EPSILON", epsilon),
        ("SUPPORT_RADIUS", support_radius),
        ("REACH_MIN", reach_min),
    ]
    .map(float)
    .concat();
    source += &[("IS_TIMED", columns.is_timed), ("ROTATES", columns.rotates), ("COMPENSATES", columns.mip)]
        .map(truth)
        .concat();
    let names =
        ["CENTER", "ROTATION", "LOG_SCALE", "LOGIT", "SH", "TAU", "LOG_WIDTH", "MOTION", "ROTATION_RATE"];
    for (column, name) in names.into_iter().enumerate() {
        source += &unsigned((name, column as u32));
        source += &unsigned((&format!("COUNT_{name}"), counts[column]));
        source += &unsigned((&format!("START_{name}"), starts[column]));
    }
    source += &list("COUNT", "u32", &counts.map(|count| format!("{count}u")));
    source += &list("START", "u32", &starts.map(|start| format!("{start}u")));
    source += &list("WINDOW", "f32", &window().map(|weight| format!("{weight:?}")));
    source
}

/// The normalised Gaussian window of SSIM.
fn window() -> [f32; WINDOW] {
    let weight = |i: usize| (-0.5 * ((i as f64 - (WINDOW / 2) as f64) / SIGMA).powi(2)).exp();
    let sum: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|i| (weight(i) / sum) as f32)
}
