//! Rust counterparts of the WGSL structs.
//!
//! Names, offsets and sizes match the WGSL declarations; tests compare them through naga.

use bytemuck::{Pod, Zeroable};

/// `Frame` of frame.wgsl: the instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    /// Normalised clip time, rounded to `f32`.
    pub time: f32,
    /// Rounding error of `time`.
    pub time_rest: f32,
    /// Limit of the support radius in standard deviations.
    pub radius_max: f32,
    /// Depth from which on Gaussians are drawn whole, in units of the field; 0 if none fades.
    pub near: f32,
}

/// `ViewUniform` of frame.wgsl: a pinhole eye in OpenCV axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ViewUniform {
    /// Columns of the rotation from the world's axes to the eye's, each padded to 16 bytes.
    pub view_from_world: [[f32; 4]; 3],
    /// Position of the eye relative to the clip's origin.
    pub eye: [f32; 3],
    /// Padding.
    pub _pad0: f32,
    /// Focal lengths in pixels.
    pub focal: [f32; 2],
    /// Principal point in pixels from the top left corner.
    pub principal: [f32; 2],
    /// Image size in pixels.
    pub size: [f32; 2],
    /// Least x/z and y/z at which a footprint is computed.
    pub slope_min: [f32; 2],
    /// Largest x/z and y/z at which a footprint is computed.
    pub slope_max: [f32; 2],
    /// Variance of the field's blur in px^2 of this view; ignored for the mip filter.
    pub blur: f32,
    /// Padding.
    pub _pad1: f32,
}

/// `Foveation` of foveate.wgsl: how the two images of an eye are composed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Foveation {
    /// Upper left corner of the inset in the composed image, in pixels.
    pub offset: [f32; 2],
    /// Size of both the inset and the wide image in pixels.
    pub size: [f32; 2],
    /// Pixels of the wide image per pixel of the composed one.
    pub wide_from_full: [f32; 2],
    /// Width in pixels of the edge in which the inset fades into the wide image.
    pub feather: f32,
    /// Padding.
    pub _pad0: f32,
}

/// `Ranges` of gaussian.wgsl: what the packed numbers of a field depend on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ranges {
    /// Factors of the motion coefficients of power 1, 2, 3.
    pub motion_units: [f32; 3],
    /// First row with temporal data.
    pub first_dynamic: u32,
}

/// `Slot` of slots.wgsl: a segment of a take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Slot {
    /// Ranges of the segment; its first dynamic row counts through all segments.
    pub ranges: Ranges,
    /// Clip time of the segment, rounded to `f32`.
    pub time: f32,
    /// Rounding error of `time`.
    pub time_rest: f32,
    /// Padding.
    pub _pad0: [f32; 2],
}

/// `Gaussian` of gaussian.wgsl: the packed record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Gaussian {
    /// Centre at the record's instant, relative to the clip's origin, as the bits of three `f32`.
    pub center: [u32; 3],
    /// Smallest-three quaternion: two components in 15 bits each, the index of the omitted one in the
    /// upper 2.
    pub rotation: u32,
    /// The third component in the lower 16 bits, the first log-scale in the upper 16.
    pub rotation_scale: u32,
    /// The second and third log-scale, 16 bits each.
    pub scales: u32,
    /// Peak opacity (unorm16), red (f16).
    pub opacity_red: u32,
    /// Green, blue (f16).
    pub green_blue: u32,
}
