//! The stages of a frame: `alive` and `sort` on the CPU; `evaluate`, `splat` and `count` on the
//! GPU, each with the WGSL file of its name.

pub(super) mod alive;
pub(super) mod count;
pub(super) mod evaluate;
pub(super) mod quads;
pub(super) mod sort;
pub(super) mod splat;
