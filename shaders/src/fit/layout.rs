//! The structs of a fit that Rust and WGSL share, field for field.

use bytemuck::{Pod, Zeroable};

/// `StepUniforms` of step.wgsl: the instant, the camera, the sizes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StepUniforms {
    /// Rows of the rigid transform: the rotation, and the translation in the last.
    pub view_from_world: [[f32; 4]; 3],
    /// Position of the eye in the world.
    pub eye: [f32; 3],
    /// Time in frames.
    pub frame: f32,
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point in pixels from the top left corner.
    pub principal: [f32; 2],
    /// Least x/z and y/z at which a footprint is computed.
    pub slope_min: [f32; 2],
    /// Largest x/z and y/z at which a footprint is computed.
    pub slope_max: [f32; 2],
    /// Of the image in pixels.
    pub size: [u32; 2],
    /// Of the image in tiles.
    pub tiles: [u32; 2],
    /// Number of Gaussians.
    pub gaussians: u32,
    /// Pairs of a splat and a tile for which there is room.
    pub pair_capacity: u32,
    /// 1 where windows' centres move by opacity alone, else 0.
    pub is_detached: u32,
    /// Padding.
    pub _pad0: u32,
}

/// `Series` of series.wgsl: what is scanned or sorted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Series {
    /// Which number of the state is the length.
    pub length_at: u32,
    /// For how many there is room.
    pub capacity: u32,
    /// Which number of the state becomes the sum.
    pub total_at: u32,
    /// The lowest bit of the digit that is sorted by, or [`NO_DIGITS`](super::NO_DIGITS).
    pub shift: u32,
}

/// `AdamUniforms` of adam.wgsl: how far a step goes, and how far at most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AdamUniforms {
    /// Step lengths of the columns; [`AdamUniforms::MOTION`] and what follows are other than they.
    pub rates: [f32; 12],
    /// Least and greatest log-scale.
    pub log_scales: [f32; 2],
    /// Least and greatest log-width.
    pub log_widths: [f32; 2],
    /// Least and greatest `tau`.
    pub tau: [f32; 2],
    /// Greatest logit, and the negative of the least.
    pub logit_max: f32,
    /// Padding.
    pub _pad0: f32,
}

impl AdamUniforms {
    /// Where the rates of the powers of time are, three.
    pub const MOTION: usize = 7;
    /// Where the rate of the rotation rates is.
    pub const ROTATION_RATE: u32 = 10;
    /// Where the rate of the spherical harmonics after the first is.
    pub const SH_REST: u32 = 11;
}

/// `Memory` of memory.wgsl: what is remembered of a Gaussian from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Memory {
    /// Sum of the pulls since the last control of the number of Gaussians.
    pub pull: f32,
    /// How many pictures showed it since.
    pub pictures: u32,
    /// How many gradients it has had.
    pub visits: u32,
    /// 1 where the gradient of the last step could be used, else 0.
    pub is_usable: u32,
}

/// What a step tells about itself: eight numbers, which the shaders know by their places.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct State {
    /// Number of Gaussians.
    pub gaussians: u32,
    /// Number of those that are drawn.
    pub drawn: u32,
    /// Pairs of a splat and a tile, also where there is no room for them.
    pub pairs: u32,
    /// Gradients that were not finite.
    pub non_finite: u32,
    /// Sum of the absolute differences over pixels and channels.
    pub absolute: f32,
    /// Sum of the similarities over pixels and channels.
    pub similarity: f32,
    /// A total that nobody asks for.
    pub spare: u32,
    /// Padding.
    pub _pad0: u32,
}

impl State {
    /// Place of [`State::gaussians`].
    pub const GAUSSIANS: u32 = 0;
    /// Place of [`State::drawn`].
    pub const DRAWN: u32 = 1;
    /// Place of [`State::pairs`].
    pub const PAIRS: u32 = 2;
    /// Place of [`State::non_finite`].
    pub const NON_FINITE: u32 = 3;
    /// Place of [`State::absolute`].
    pub const ABSOLUTE: u32 = 4;
    /// Place of [`State::similarity`].
    pub const SIMILARITY: u32 = 5;
    /// Place of [`State::spare`].
    pub const SPARE: u32 = 6;
}
