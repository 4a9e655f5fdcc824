//! Reference renderer, rankings, pruning and coding of 4D Gaussian fields.
#![forbid(unsafe_code)]

pub mod code;
pub mod image;
pub mod prune;
pub mod reference;
