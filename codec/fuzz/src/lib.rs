//! Shared by the fuzz targets: the properties that must hold, a mutator that works under checksums and
//! compression, and the initial corpus.

pub mod mutation;
pub mod properties;
pub mod seeds;
pub mod sound;

#[path = "../../tests/common/mod.rs"]
mod common;
