//! The stages of a fit: compute shaders that draw Gaussians, compare the picture with a photograph,
//! follow the derivatives back and take Adam's step.
//!
//! ```text
//! project -> sort -> bin -> rasterize -> loss -> rasterize_backward -> project_backward -> adam
//! ```
//!
//! [`compose`] puts a stage together for the columns that a scene has; what it does not have is neither
//! memory nor code. A stage has one or more kernels, [`Stage::kernels`]. All bindings are in group 0; a
//! buffer has the same number in every stage that binds it, see [`binding`]. No kernel binds more than
//! the eight storage buffers that every device has.

pub mod layout;
#[cfg(test)]
mod tests;

use crate::{ALPHA_MAX, ALPHA_MIN, BLUR, NEAR};

/// A pixel is finished before the fragment that would bring its transmittance down to this.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Side of a tile in pixels.
pub const TILE: u32 = 16;
/// Quaternions that are not longer have no direction.
pub const LENGTH_MIN: f32 = 1e-12;
/// Adam's decay of the means of gradients and of their squares, and what keeps it from dividing by 0.
pub const ADAM: [f32; 3] = [0.9, 0.999, 1e-15];
/// Weight of structural dissimilarity in the loss against that of absolute differences.
pub const LAMBDA: f32 = 0.2;

/// Threads of a group of most kernels.
pub const GROUP: u32 = 64;
/// Values of the digits that [`Stage::Sort`] sorts by.
pub const DIGITS: u32 = 1 << DIGIT_BITS;
/// Bits of these digits.
pub const DIGIT_BITS: u32 = 5;
/// Neighbours that a thread of [`Stage::Sort`] takes.
pub const CHUNK: u32 = 64;
/// Neighbours that a thread of [`Stage::Scan`] takes.
pub const BLOCK: u32 = 64;
/// Numbers that `rasterize_backward` leaves for each pair of a splat and a tile.
pub const SPLAT_NUMBERS: u32 = 9;
/// Columns of the parameters: centres, rotations, log-scales, logits, spherical harmonics, `tau`,
/// log-widths, motion, rotation rates.
pub const COLUMNS: usize = 9;
/// [`layout::Series::shift`] of what is scanned as it is.
pub const NO_DIGITS: u32 = 32;

/// Threads of a kernel of a single group.
const SCAN_GROUP: u32 = 256;
/// Key of what is not drawn.
const NOT_DRAWN: u32 = u32::MAX;
/// Added to the squared distance in standard deviations at which alpha is 1/255: a margin above the
/// rounding of exponentials.
const FAR_MARGIN: f32 = 256.0 * f32::EPSILON;
/// Window of structural similarity and its standard deviation in pixels.
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;

/// Numbers of the bindings in group 0.
pub mod binding {
    /// [`StepUniforms`](super::layout::StepUniforms).
    pub const STEP: u32 = 0;
    /// [`Series`](super::layout::Series).
    pub const SERIES: u32 = 1;
    /// [`AdamUniforms`](super::layout::AdamUniforms).
    pub const PACE: u32 = 2;
    /// [`State`](super::layout::State).
    pub const STATE: u32 = 3;
    /// The columns, one after the other: `f32`.
    pub const PARAMETERS: u32 = 4;
    /// A splat of [`SPLAT_BYTES`](super::SPLAT_BYTES) per Gaussian.
    pub const SPLATS: u32 = 5;
    /// What is sorted by: `u32`.
    pub const KEYS: u32 = 6;
    /// What belongs to the keys: `u32`.
    pub const ROWS: u32 = 7;
    /// [`KEYS`], sorted.
    pub const SORTED_KEYS: u32 = 8;
    /// [`ROWS`], sorted.
    pub const SORTED_ROWS: u32 = 9;
    /// What is scanned: `u32`.
    pub const COUNTS: u32 = 10;
    /// Sums of its blocks: `u32`.
    pub const BLOCK_SUMS: u32 = 11;
    /// Rows of the splats that are drawn, front to back: `u32`.
    pub const ORDER: u32 = 12;
    /// Where the pairs of each tile begin, and where the last ones end: `u32`.
    pub const TILE_STARTS: u32 = 13;
    /// Red, green, blue over black, and alpha of each pixel: 4 `f32`.
    pub const PICTURE: u32 = 14;
    /// Red, green, blue and whether it is seen, a byte each, of each pixel: `u32`.
    pub const PHOTOGRAPH: u32 = 15;
    /// Means of the windows, then their derivatives, along rows: 15 `f32` per pixel.
    pub const BLURRED: u32 = 16;
    /// Derivatives by the means of the windows: 9 `f32` per pixel.
    pub const DERIVATIVES: u32 = 17;
    /// Sums over the channels: 2 `f32` per pixel.
    pub const DIFFERENCES: u32 = 18;
    /// Gradient by the picture: 4 `f32` per pixel.
    pub const D_PICTURE: u32 = 19;
    /// Sums for each pair of a splat and a tile: [`SPLAT_NUMBERS`](super::SPLAT_NUMBERS) `f32`.
    pub const D_PAIRS: u32 = 20;
    /// Gradient by the parameters of what was drawn, in columns like [`PARAMETERS`].
    pub const D_PARAMETERS: u32 = 21;
    /// [`Memory`](super::layout::Memory) per Gaussian.
    pub const MEMORY: u32 = 22;
    /// Adam's means of the gradients, like [`PARAMETERS`].
    pub const FIRST_MOMENTS: u32 = 23;
    /// Adam's means of their squares, like [`PARAMETERS`].
    pub const SECOND_MOMENTS: u32 = 24;
    /// Of each pair of a splat and a tile that it reaches, the tile: `u32`.
    pub const PAIR_TILES: u32 = 25;
    /// Of each pair, the row of the splat: `u32`.
    pub const PAIR_ROWS: u32 = 26;
    /// Numbers of the pairs, once sorted tile by tile, front to back: `u32`.
    pub const TILE_PAIRS: u32 = 27;
}

/// Bytes of a splat.
pub const SPLAT_BYTES: u64 = 64;

/// The columns that a scene has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns {
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Whether Gaussians have windows.
    pub is_timed: bool,
    /// Highest power of time in the trajectories, 0 to 3.
    pub motion_order: u8,
    /// Whether Gaussians turn.
    pub rotates: bool,
}

impl Columns {
    /// How many numbers a Gaussian has in each column.
    pub fn counts(self) -> [u32; COLUMNS] {
        let timed = u32::from(self.is_timed);
        let turning = if self.rotates { 4 } else { 0 };
        [3, 4, 3, 1, 3 * self.harmonics(), timed, timed, 3 * u32::from(self.motion_order), turning]
    }

    /// How many numbers a Gaussian has.
    pub fn numbers(self) -> u32 {
        self.counts().iter().sum()
    }

    fn harmonics(self) -> u32 {
        (u32::from(self.sh_degree) + 1).pow(2)
    }
}

/// A stage: one shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The splats that can reach a pixel.
    Project,
    /// Sums of all numbers before each.
    Scan,
    /// Sorts by a digit.
    Sort,
    /// Which splats reach which tile.
    Bin,
    /// The picture.
    Rasterize,
    /// How far it is from the photograph.
    Loss,
    /// From the gradient by the picture to that by splats.
    RasterizeBackward,
    /// From that to the gradient by the parameters.
    ProjectBackward,
    /// A step along it.
    Adam,
}

impl Stage {
    /// All of them.
    pub const ALL: [Stage; 9] = [
        Stage::Project,
        Stage::Scan,
        Stage::Sort,
        Stage::Bin,
        Stage::Rasterize,
        Stage::Loss,
        Stage::RasterizeBackward,
        Stage::ProjectBackward,
        Stage::Adam,
    ];

    /// Names of its entry points.
    pub fn kernels(self) -> &'static [&'static str] {
        match self {
            Stage::Project => &["project"],
            Stage::Scan => &["scan_blocks", "scan_totals"],
            Stage::Sort => &["count_digits", "scatter"],
            Stage::Bin => &["count_tiles", "list_pairs", "find_tiles"],
            Stage::Rasterize => &["rasterize"],
            Stage::Loss => &["blur_rows", "compare", "blur_derivatives", "loss_backward", "sum_loss"],
            Stage::RasterizeBackward => &["rasterize_backward"],
            Stage::ProjectBackward => &["project_backward"],
            Stage::Adam => &["adam"],
        }
    }
}

/// The WGSL source of a stage for a scene with `columns`.
pub fn compose(stage: Stage, columns: Columns) -> String {
    let thread = include_str!("../fit/thread.wgsl");
    let step = include_str!("../fit/step.wgsl");
    let splat = include_str!("../fit/splat.wgsl");
    let places = include_str!("../fit/columns.wgsl");
    let parameters = include_str!("../fit/parameters.wgsl");
    let harmonics = include_str!("../fit/harmonics.wgsl");
    let projection = include_str!("../fit/projection.wgsl");
    let ellipse = include_str!("../fit/ellipse.wgsl");
    let footprint = include_str!("../fit/footprint.wgsl");
    let series = include_str!("../fit/series.wgsl");
    let memory = include_str!("../fit/memory.wgsl");
    let parts: &[&str] = match stage {
        Stage::Project => {
            let project = include_str!("../fit/project.wgsl");
            &[step, splat, places, parameters, harmonics, projection, ellipse, project]
        }
        Stage::Scan => &[series, include_str!("../fit/scan.wgsl")],
        Stage::Sort => &[series, include_str!("../fit/sort.wgsl")],
        Stage::Bin => &[step, splat, ellipse, include_str!("../fit/bin.wgsl")],
        Stage::Rasterize => &[step, splat, footprint, include_str!("../fit/rasterize.wgsl")],
        Stage::Loss => &[step, include_str!("../fit/loss.wgsl")],
        Stage::RasterizeBackward => &[step, splat, footprint, include_str!("../fit/rasterize_backward.wgsl")],
        Stage::ProjectBackward => {
            let project_backward = include_str!("../fit/project_backward.wgsl");
            &[step, splat, places, parameters, harmonics, projection, memory, project_backward]
        }
        Stage::Adam => &[step, places, memory, include_str!("../fit/adam.wgsl")],
    };
    constants(columns) + thread + &parts.concat()
}

/// What the shaders call by name.
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
    let log = |beta: f32| f64::from(beta).ln() as f32;
    let mut source: String = [
        ("TILE", TILE),
        ("GROUP", GROUP),
        ("SCAN_GROUP", SCAN_GROUP),
        ("DIGITS", DIGITS),
        ("NO_DIGITS", NO_DIGITS),
        ("CHUNK", CHUNK),
        ("BLOCK", BLOCK),
        ("NOT_DRAWN", NOT_DRAWN),
        ("SPLAT_NUMBERS", SPLAT_NUMBERS),
        ("DRAWN", layout::State::DRAWN),
        ("PAIRS", layout::State::PAIRS),
        ("NON_FINITE", layout::State::NON_FINITE),
        ("ABSOLUTE", layout::State::ABSOLUTE),
        ("SIMILARITY", layout::State::SIMILARITY),
        ("HARMONICS", columns.harmonics()),
        ("MOTION_ORDER", columns.motion_order.into()),
        ("NUMBERS", columns.numbers()),
        ("COLUMNS", COLUMNS as u32),
        ("SH_REST", layout::AdamUniforms::SH_REST),
        ("ROTATION_RATE_AT", layout::AdamUniforms::ROTATION_RATE),
    ]
    .map(unsigned)
    .concat();
    source += &[
        ("ALPHA_MIN", ALPHA_MIN),
        ("ALPHA_MAX", ALPHA_MAX),
        ("NEAR", NEAR),
        ("BLUR", BLUR),
        ("TRANSMITTANCE_MIN", TRANSMITTANCE_MIN),
        ("LENGTH_MIN", LENGTH_MIN),
        ("FAR_MARGIN", FAR_MARGIN),
        ("LAMBDA", LAMBDA),
        ("BETA1", beta1),
        ("BETA2", beta2),
        ("LOG_BETA1", log(beta1)),
        ("LOG_BETA2", log(beta2)),
        ("EPSILON", epsilon),
    ]
    .map(float)
    .concat();
    source += &[("IS_TIMED", columns.is_timed), ("TURNS", columns.rotates)].map(truth).concat();
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

/// The weights of the window of structural similarity: of a normal distribution, with the sum 1.
fn window() -> [f32; WINDOW] {
    let weight = |i: usize| (-0.5 * ((i as f64 - (WINDOW / 2) as f64) / SIGMA).powi(2)).exp();
    let sum: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|i| (weight(i) / sum) as f32)
}
