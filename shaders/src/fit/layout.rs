//! The structs of a fit that Rust and WGSL share, field by field.

use bytemuck::{Pod, Zeroable};

/// `StepUniforms` of uniforms.wgsl: time, camera, sizes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct StepUniforms {
    /// Rows of the rigid transform: the rotation, and the translation in the last column.
    pub view_from_world: [[f32; 4]; 3],
    /// Position of the camera in the world.
    pub eye: [f32; 3],
    /// Time in intervals.
    pub time: f32,
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point in pixels from the top left corner.
    pub principal: [f32; 2],
    /// Lowest x/z and y/z at which the Jacobian is evaluated.
    pub slope_min: [f32; 2],
    /// Highest x/z and y/z at which the Jacobian is evaluated.
    pub slope_max: [f32; 2],
    /// Size of the image in pixels.
    pub size: [u32; 2],
    /// Size of the image in tiles.
    pub tiles: [u32; 2],
    /// Number of Gaussians.
    pub gaussians: u32,
    /// Capacity of the buffers of splat-tile pairs.
    pub pair_capacity: u32,
    /// 1 to stop the gradient of positions and rotations with respect to `tau`, else 0.
    pub detach_tau: u32,
    /// Depth from which on Gaussians are drawn whole; 0 if none fades.
    pub near: f32,
    /// Weight of alpha in the loss, against a channel of colour.
    pub alpha_channels: f32,
    /// 1 if the buffer of the image's gradient has the gradient of another term, to which the loss adds its own; else 0.
    pub adds_gradient: u32,
    /// 1 to leave the gradient with respect to the camera, else 0.
    pub learns_camera: u32,
    #[doc(hidden)]
    pub _pad0: u32,
}

/// `Series` of sort.wgsl: the input of a pass of a sort.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Series {
    /// Index of its length in the [`Totals`].
    pub length_at: u32,
    /// Its capacity; a longer series counts as empty.
    pub capacity: u32,
    /// Index in the [`Totals`] that receives the number of keys that are not dropped.
    pub total_at: u32,
    /// Lowest bit of the digit that is sorted by.
    pub shift: u32,
}

/// `AdamUniforms` of adam.wgsl: learning rates, bounds and fragment term.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AdamUniforms {
    /// Learning rates by column, and of the spherical harmonics of degrees 1 to 3 at [`AdamUniforms::SH_REST`].
    /// Motion has the rate of the centre, which the shader divides by powers of a window's reach.
    pub rates: [f32; 12],
    /// Smallest and largest log-scale.
    pub log_scales: [f32; 2],
    /// Smallest and largest log-width.
    pub log_widths: [f32; 2],
    /// Smallest and largest `tau`.
    pub tau: [f32; 2],
    /// Largest logit; the smallest is its negative.
    pub logit_max: f32,
    /// Weight of the area of the drawn Gaussians in the loss.
    pub fragment_weight: f32,
    /// Longest reach of a window, in intervals.
    pub reach_max: f32,
    /// Padding.
    pub _pad0: [u32; 3],
}

impl AdamUniforms {
    /// Index of the rate of the spherical harmonics of degrees 1 to 3, behind the columns.
    pub const SH_REST: u32 = 9;
}

/// `Response` of response.wgsl: how a camera shows colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Response {
    /// Rows give red, green and blue: three factors of the image's colours, and an addend.
    pub color: [[f32; 4]; 3],
    /// `v` of the factor `1 + v r^2`, where `r` is 1 in the corners.
    pub vignette: f32,
    /// Padding.
    pub _pad0: [u32; 3],
}

/// `Statistics` of statistics.wgsl: the statistics of a Gaussian, kept from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Statistics {
    /// Sum of the norms of the screen-space gradients since the last capacity control.
    pub screen_gradient: f32,
    /// Number of images that showed it since.
    pub images: u32,
    /// Number of gradients in Adam's moments.
    pub visits: u32,
    /// 1 if Adam could use the gradient of the last step, else 0.
    pub is_usable: u32,
    /// Factor of the learning rates, 0 to 1.
    pub share: f32,
    /// That of the columns of time: window, motion and rotation rates.
    pub share_of_time: f32,
    /// 1 if it is drawn behind all others, else 0.
    pub is_behind: u32,
}

/// The results of a step: eight numbers, which the shaders address by index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Totals {
    /// Number of Gaussians.
    pub gaussians: u32,
    /// Number of drawn Gaussians.
    pub drawn: u32,
    /// Number of splat-tile pairs, even if it exceeds their capacity.
    pub pairs: u32,
    /// Number of gradients that were not finite.
    pub non_finite: u32,
    /// Sum of the absolute differences over pixels and channels.
    pub absolute: f32,
    /// Sum of the similarities over pixels and channels.
    pub similarity: f32,
    /// Receives the totals of sorts that are not needed.
    pub spare: u32,
    /// 1 if this step or one before it had more pairs than their buffers held, else 0. Such steps change nothing.
    pub halted: u32,
}

impl Totals {
    /// Index of [`Totals::gaussians`].
    pub const GAUSSIANS: u32 = 0;
    /// Index of [`Totals::drawn`].
    pub const DRAWN: u32 = 1;
    /// Index of [`Totals::pairs`].
    pub const PAIRS: u32 = 2;
    /// Index of [`Totals::non_finite`].
    pub const NON_FINITE: u32 = 3;
    /// Index of [`Totals::absolute`].
    pub const ABSOLUTE: u32 = 4;
    /// Index of [`Totals::similarity`].
    pub const SIMILARITY: u32 = 5;
    /// Index of [`Totals::spare`].
    pub const SPARE: u32 = 6;
    /// Index of [`Totals::halted`].
    pub const HALTED: u32 = 7;
}
