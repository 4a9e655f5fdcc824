//! Captures, reference renderer, rankings, pruning, coding and evaluation of 4D Gaussian fields.
#![forbid(unsafe_code)]

pub mod anchor;
pub mod capture;
pub mod code;
pub mod fit;
pub mod image;
mod median;
pub mod metrics;
pub mod prune;
pub mod reference;
