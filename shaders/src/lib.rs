//! The WGSL stages, and Rust counterparts of the structs they share.
//!
//! [`compose`] concatenates the files that the [`Features`] of a clip require, so features that a clip lacks
//! are neither code nor bindings. The stages of fitting are in `fit`, behind the Cargo feature of that name.
//!
//! | group | binding | content | stage |
//! |---|---|---|---|
//! | 0 | [`FRAME`] | [`layout::Frame`] | both |
//! | 0 | [`VIEWS`] | array of [`layout::ViewUniform`], one per eye of the pass | vertex |
//! | 1 | [`RANGES`] | [`layout::Ranges`]; with [`Features::segmented`] [`SLOTS`] of [`layout::Slot`] | vertex |
//! | 1 | [`GAUSSIANS`] | array of [`layout::Gaussian`] | vertex |
//! | 1 | [`ORDER`] | array of `u32`: rows to draw, back to front; with [`Features::segmented`] their slots above [`ROW_BITS`] bits | vertex |
//! | 1 | [`MOTION`] | with [`Features::motion`]: array of `u32`, [`Motion::words`] per dynamic row; with [`Features::segmented`] per row | vertex |
//! | 1 | [`SH`] | with [`Features::sh_degree`]: array of `u32`, [`sh_words`] per row | vertex |
//! | 0 | [`FOVEATION`], [`WIDE`], [`INSET`], [`LINEAR`] | of the stage `foveate`: how and what it composes | fragment |
//! | 0 | [`DRAWN`] | of the stage `linear_light`: the image that it converts | fragment |
//! | 2 | [`COUNTS`] | for [`Purpose::Count`]: array of `u32`, fragments per quad | fragment |

#[cfg(feature = "fit")]
pub mod fit;
pub mod layout;

#[cfg(test)]
mod tests;

/// Least alpha that is drawn: 1/255.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;

/// Upper limit of a fragment's alpha.
pub const ALPHA_MAX: f32 = 0.999;

/// Share of the near distance up to which nothing is drawn.
pub const FADE_START: f32 = 0.5;

/// Variance of a field's filter, added to the variances of every footprint, in px^2, so that no splat falls between
/// pixels: of the mip filter, which compensates opacities, or of blur.
pub const fn filter_variance(mip: bool) -> f32 {
    if mip { 0.1 } else { 0.3 }
}

/// Unit of the 16-bit `1/s`: the narrowest window is `1 / (65504 WIDTH_UNIT)` of the clip, 5e-7. Windows wider
/// than 500 clips lose precision, without a visible effect.
pub const WIDTH_UNIT: f32 = 32.0;

/// Largest magnitude of a log-scale: 2e-9 to 5e8 units. 16 bits hold the range from minus this, the same for all fields,
/// in steps of 0.0006.
pub const LOG_SCALE_MAX: f32 = 20.0;

/// Log-scale per step of the 16-bit number.
pub const LOG_SCALE_STEP: f32 = 2.0 * LOG_SCALE_MAX / 65535.0;

/// Unit of the 16-bit angular rates per width of a window: up to 2^21, and exact to a millionth.
pub const RATE_UNIT: f32 = 32.0;

/// Binding of the instant in group 0.
pub const FRAME: u32 = 0;
/// Binding of the eyes in group 0.
pub const VIEWS: u32 = 1;
/// Binding of a field's ranges in group 1, or of the slots of a take.
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

/// Most segments of a take in GPU memory.
pub const SLOTS: u32 = 32;
/// Bits of a row in an entry of a take's draw order; the bits above are its slot.
pub const ROW_BITS: u32 = 26;

/// Corners of a Gaussian's quad.
pub const CORNERS: u32 = 4;

/// Quads per instance. With one quad per instance, hardware starts a thread group for four vertices, and a
/// software driver repeats the work of a draw call.
pub const BATCH: u32 = 1024;

/// Name of the vertex entry point.
pub const VERTEX_ENTRY: &str = "vertex";
/// Name of the fragment entry point.
pub const FRAGMENT_ENTRY: &str = "fragment";

/// Features of a field that a shader must support.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Features {
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Temporal data; `None` for a static field.
    pub motion: Option<Motion>,
    /// Whether the field has the mip filter, which compensates opacities.
    pub mip: bool,
    /// Whether the Gaussians belong to several segments, each in a slot with ranges and a clip time of its own.
    pub segmented: bool,
}

/// The temporal data of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Motion {
    /// Highest power of time in the trajectories, 0 to 3.
    pub order: u8,
    /// Whether Gaussians rotate.
    pub rotates: bool,
}

impl Motion {
    /// Number of 16-bit floats per dynamic row: 1/s, the motion coefficients, the angular rate.
    pub const fn halves(self) -> usize {
        1 + 3 * self.order as usize + if self.rotates { 4 } else { 0 }
    }

    /// Number of 32-bit words per dynamic row: the instant and the 16-bit floats.
    pub const fn words(self) -> usize {
        1 + self.halves().div_ceil(2)
    }
}

/// Number of 32-bit words of spherical harmonics per row: the largest coefficient, then one word per
/// coefficient above degree 0; none at degree 0.
pub const fn sh_words(degree: u8) -> usize {
    if degree == 0 { 0 } else { (degree as usize + 1) * (degree as usize + 1) }
}

/// Purpose of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// Draws `views` eyes in one pass; more than one requires multiview.
    Draw {
        /// Number of eyes.
        views: u32,
        /// Whether frames may be foveated.
        foveated: bool,
        /// Whether fragments are evaluated in f16, which the device must support.
        f16: bool,
    },
    /// Counts fragments, one eye per pass.
    Count {
        /// Whether frames may be foveated.
        foveated: bool,
    },
}

/// Bindings of the stage `foveate` in group 0: the array of [`layout::Foveation`], one per eye of the pass.
pub const FOVEATION: u32 = 0;
/// The coarse image of all of the view.
pub const WIDE: u32 = 1;
/// The sharp image of its middle.
pub const INSET: u32 = 2;
/// The linear sampler.
pub const LINEAR: u32 = 3;

/// Binding in group 0 of the image that the stage `linear_light` converts.
pub const DRAWN: u32 = 0;

/// Composes the WGSL source of the stage `foveate` for passes of `views` eyes; more than one requires multiview. With
/// `linear`, the composed image goes through the stage `linear_light`.
pub fn compose_foveate(views: u32, linear: bool) -> String {
    let (stage, color) = match linear {
        true => (include_str!("../linear_light.wgsl"), "linear_light(composed(position.xy, EYE))"),
        false => ("", "composed(position.xy, EYE)"),
    };
    let source = format!("const VIEWS: u32 = {views}u;\n{}{stage}", include_str!("../foveate.wgsl"));
    covering(source, views, color)
}

/// Composes the WGSL source of the stage `linear_light` for passes of `views` eyes; more than one requires multiview.
pub fn compose_linear_light(views: u32) -> String {
    let source = format!(
        "@group(0) @binding({DRAWN}) var drawn: texture_2d_array<f32>;\n{}",
        include_str!("../linear_light.wgsl")
    );
    covering(source, views, "linear_light(textureLoad(drawn, vec2<i32>(position.xy), EYE, 0))")
}

/// `source` with the entry points of a stage that gives every pixel at `position` of `EYE` the colour `color`.
fn covering(source: String, views: u32, color: &str) -> String {
    let (input, eye) = match views {
        1 => ("", "0u"),
        _ => (", @builtin(view_index) eye: u32", "eye"),
    };
    format!(
        "{source}{}\n@fragment\n\
         fn fragment(@builtin(position) position: vec4<f32>{input}) -> @location(0) vec4<f32> {{\n    \
         return {};\n}}\n",
        include_str!("../cover.wgsl"),
        color.replace("EYE", eye)
    )
}

/// What the shaders of a take read in place of what the files read, which is a clip's. The trajectory exists once, and
/// a clip's shaders are the files as they are.
const SEGMENTED: [(&str, &str); 5] = [
    ("@group(1) @binding(0) var<uniform> ranges: Ranges;\n", include_str!("../slots.wgsl")),
    ("order[place]", "row_in_slot(order[place])"),
    // A take's motion has a record for every row: one allocation of rows places all columns of a segment.
    ("(index - ranges.first_dynamic) * MOTION_WORDS", "index * MOTION_WORDS"),
    ("frame.time -", "slot_time -"),
    ("frame.time_rest;", "slot_time_rest;"),
];

/// Composes the WGSL source for a field with `features`.
pub fn compose(features: Features, purpose: Purpose) -> String {
    let source = compose_clip(features, purpose);
    if !features.segmented {
        return source;
    }
    let segmented = SEGMENTED.iter().fold(source, |source, (clip, take)| source.replace(clip, take));
    format!("{segmented}const SLOTS: u32 = {SLOTS}u;\nconst ROW_BITS: u32 = {ROW_BITS}u;\n")
}

/// The source for a clip with `features`.
// Long: one part of the source after the other.
fn compose_clip(features: Features, purpose: Purpose) -> String {
    let (views, foveated) = match purpose {
        Purpose::Draw { views, foveated, .. } => (views, foveated),
        Purpose::Count { foveated } => (1, foveated),
    };
    let [enabled, real] = match purpose {
        Purpose::Draw { f16: true, .. } => ["enable f16;\n", "alias real = f16;\n"],
        Purpose::Draw { .. } => ["", "alias real = f32;\n"],
        Purpose::Count { .. } => ["", ""],
    };
    let mut source = format!(
        "{enabled}{real}const ALPHA_MIN: f32 = {ALPHA_MIN:?};\n\
         const ALPHA_MAX: f32 = {ALPHA_MAX:?};\n\
         const FADE_START: f32 = {FADE_START:?};\n\
         const FILTER: f32 = {:?};\n\
         const WIDTH_UNIT: f32 = {WIDTH_UNIT:?};\n\
         const RATE_UNIT: f32 = {RATE_UNIT:?};\n\
         const LOG_SCALE_MAX: f32 = {LOG_SCALE_MAX:?};\n\
         const LOG_SCALE_STEP: f32 = {LOG_SCALE_STEP:?};\n\
         const CORNERS: u32 = {CORNERS}u;\n\
         const BATCH: u32 = {BATCH}u;\n\
         const VIEWS: u32 = {views}u;\n",
        filter_variance(features.mip)
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
    source += match (features.mip, foveated) {
        (true, _) => include_str!("../filter_mip.wgsl"),
        (false, true) => include_str!("../filter_blur_foveated.wgsl"),
        (false, false) => include_str!("../filter_blur.wgsl"),
    };
    source += include_str!("../near.wgsl");
    source += include_str!("../splat.wgsl");
    source += match purpose {
        Purpose::Draw { .. } => include_str!("../draw.wgsl"),
        Purpose::Count { .. } => include_str!("../count.wgsl"),
    };
    source += match views {
        1 => include_str!("../eye_single.wgsl"),
        _ => include_str!("../eye_multiview.wgsl"),
    };
    source
}
