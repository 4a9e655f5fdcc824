//! Kinds of input of the fuzzers that have several: the first byte of an input chooses one.

/// Kinds of `capture`.
pub(crate) mod capture {
    pub(crate) const MANIFEST: u8 = 0;
    pub(crate) const EASYVOLCAP: u8 = 1;
    pub(crate) const TRANSFORMS: u8 = 2;
    pub(crate) const COLMAP_BINARY: u8 = 3;
    pub(crate) const COLMAP_TEXT: u8 = 4;
    pub(crate) const PHOTOGRAPH: u8 = 5;
    pub(crate) const DEPTH_PFM: u8 = 6;
    pub(crate) const DEPTH_NPY: u8 = 7;
    pub(crate) const DEPTH_PNG: u8 = 8;
    pub(crate) const KINDS: u8 = 9;
}

/// Kinds of `import`: the file that the rest of the input becomes.
pub(crate) mod import {
    pub(crate) const FILE: u8 = 0;
    pub(crate) const SPLAT: u8 = 1;
    pub(crate) const SOG_META: u8 = 2;
    pub(crate) const SOG_IMAGE: u8 = 3;
    pub(crate) const KSPLAT: u8 = 4;
    pub(crate) const GLTF: u8 = 5;
    /// A frame after two others.
    pub(crate) const FRAME: u8 = 6;
    pub(crate) const KINDS: u8 = 7;
}

/// Kinds of `scene`.
pub(crate) mod scene {
    pub(crate) const OVERRIDES: u8 = 0;
    pub(crate) const CAMERA: u8 = 1;
}
