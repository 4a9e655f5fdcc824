//! The stages of a frame: `alive` and `sort` on the CPU; `evaluate`, `splat`, `foveate`, `linear_light` and `count` on
//! the GPU, in WGSL files of the same names. `clip` is what they read, `drawn_set` what is drawn of it in a frame.

pub(super) mod alive;
pub(super) mod clip;
pub(super) mod count;
pub(super) mod drawn_set;
pub(super) mod evaluate;
pub(super) mod foveate;
pub(super) mod linear_light;
pub(super) mod quads;
pub(super) mod sort;
pub(super) mod splat;
