//! The WGSL stages and the Rust counterparts of the structs they share.
//!
//! A shader is put together for the clip it draws: [`compose`] concatenates the files that the
//! clip's [`Features`] call for. What a clip does not have is then neither code nor binding. The stages of
//! fitting, which players do without, are in `fit`, behind the feature of that name.
//!
//! | group | binding | what | stage |
//! |---|---|---|---|
//! | 0 | [`FRAME`] | [`layout::Frame`] | both |
//! | 0 | [`VIEWS`] | array of [`layout::ViewUniform`], one per eye of the pass | vertex |
//! | 1 | [`RANGES`] | [`layout::Ranges`] | vertex |
//! | 1 | [`GAUSSIANS`] | array of [`layout::Gaussian`] | vertex |
//! | 1 | [`ORDER`] | rows to draw, back to front: array of `u32` | vertex |
//! | 1 | [`MOTION`] | with [`Features::motion`]: array of `u32`, [`Motion::words`] a moving row | vertex |
//! | 1 | [`SH`] | with [`Features::sh_degree`]: array of `u32`, [`sh_words`] a row | vertex |
//! | 2 | [`COUNTS`] | for [`Purpose::Count`]: fragments of every rectangle | fragment |

#[cfg(feature = "fit")]
pub mod fit;
pub mod layout;

#[cfg(test)]
mod tests;

/// Least alpha that is drawn: 1/255.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;

/// No fragment is fully opaque.
pub const ALPHA_MAX: f32 = 0.999;

/// Distance in front of the eye, in units of the field, from which Gaussians are drawn.
pub const NEAR: f32 = 0.01;

/// Added to the variances of every footprint, in px^2: a splat never falls between pixels.
pub const BLUR: f32 = 0.3;

/// Unit of the 16-bit `1/s`: the narrowest window is `1 / (65504 WIDTH_UNIT)` of the clip, 5e-7. Of
/// those wider than 500 clips less is kept, and nobody sees it.
pub const WIDTH_UNIT: f32 = 32.0;

/// Binding of the instant in group 0.
pub const FRAME: u32 = 0;
/// Binding of the eyes in group 0.
pub const VIEWS: u32 = 1;
/// Binding of a field's ranges in group 1.
pub const RANGES: u32 = 0;
/// Binding of a field's records in group 1.
pub const GAUSSIANS: u32 = 1;
/// Binding of the sorted rows in group 1.
pub const ORDER: u32 = 2;
/// Binding of a field's temporal data in group 1.
pub const MOTION: u32 = 3;
/// Binding of a field's spherical harmonics above degree 0 in group 1.
pub const SH: u32 = 4;
/// Binding of the fragment counts in group 2.
pub const COUNTS: u32 = 0;

/// Corners of the rectangle that a Gaussian is drawn as.
pub const CORNERS: u32 = 4;

/// Rectangles of an instance. With one each, hardware would start a group of threads for four
/// corners, and a software driver all that it does for a draw call.
pub const BATCH: u32 = 1024;

/// Name of the vertex entry point.
pub const VERTEX_ENTRY: &str = "vertex";
/// Name of the fragment entry point.
pub const FRAGMENT_ENTRY: &str = "fragment";

/// What a field has that a shader must handle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Features {
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Temporal data; `None` where nothing moves or fades.
    pub motion: Option<Motion>,
}

/// The temporal data of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Motion {
    /// Highest power of time in the trajectories, 0 to 3.
    pub order: u8,
    /// Whether Gaussians turn.
    pub rotates: bool,
}

impl Motion {
    /// Number of 16-bit floats a moving row has: 1/s, the motion coefficients, the rate of rotation.
    pub const fn halves(self) -> usize {
        1 + 3 * self.order as usize + if self.rotates { 4 } else { 0 }
    }

    /// Number of 32-bit words a moving row has: the instant it is about, and the 16-bit floats.
    pub const fn words(self) -> usize {
        1 + self.halves().div_ceil(2)
    }
}

/// Number of 32-bit words of spherical harmonics a row has: the largest coefficient, then one for
/// each above degree 0. None at degree 0.
pub const fn sh_words(degree: u8) -> usize {
    if degree == 0 { 0 } else { (degree as usize + 1) * (degree as usize + 1) }
}

/// What a pipeline is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// Drawing, `views` eyes in one pass; more than one takes multiview.
    Draw {
        /// Number of eyes.
        views: u32,
    },
    /// Counting fragments, one eye a pass.
    Count,
}

/// The WGSL source for a field with `features`.
pub fn compose(features: Features, purpose: Purpose) -> String {
    let views = match purpose {
        Purpose::Draw { views } => views,
        Purpose::Count => 1,
    };
    let mut source = format!(
        "const ALPHA_MIN: f32 = {ALPHA_MIN:?};\n\
         const ALPHA_MAX: f32 = {ALPHA_MAX:?};\n\
         const NEAR: f32 = {NEAR:?};\n\
         const BLUR: f32 = {BLUR:?};\n\
         const WIDTH_UNIT: f32 = {WIDTH_UNIT:?};\n\
         const CORNERS: u32 = {CORNERS}u;\n\
         const BATCH: u32 = {BATCH}u;\n\
         const VIEWS: u32 = {views}u;\n"
    );
    source += include_str!("../frame.wgsl");
    source += include_str!("../gaussian.wgsl");
    source += &match features.motion {
        Some(motion) => format!(
            "const MOTION_ORDER: u32 = {}u;\nconst MOTION_WORDS: u32 = {}u;\nconst ROTATES: bool = {};\n{}",
            motion.order,
            motion.words(),
            motion.rotates,
            include_str!("../evaluate.wgsl"),
        ),
        None => include_str!("../evaluate_static.wgsl").to_owned(),
    };
    source += &match features.sh_degree {
        0 => include_str!("../color_flat.wgsl").to_owned(),
        degree => format!(
            "const SH_DEGREE: u32 = {degree}u;\nconst SH_WORDS: u32 = {}u;\n{}",
            sh_words(degree),
            include_str!("../color_sh.wgsl"),
        ),
    };
    source += include_str!("../splat.wgsl");
    source += match purpose {
        Purpose::Draw { .. } => include_str!("../draw.wgsl"),
        Purpose::Count => include_str!("../count.wgsl"),
    };
    source += match views {
        1 => include_str!("../eye_single.wgsl"),
        _ => include_str!("../eye_multiview.wgsl"),
    };
    source
}
