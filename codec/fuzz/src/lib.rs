//! What the fuzz targets share: the properties that must hold, a mutator that gets past checksums
//! and compression, and the packages to start from.

pub mod mutation;
pub mod properties;
pub mod seeds;

#[path = "../../tests/common/mod.rs"]
mod common;
