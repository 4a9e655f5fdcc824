//! Harness of the tests across crates.
//!
//! Tests that need a graphics adapter or a display run under [`libtest_mimic`], which prints what
//! the standard harness prints but lets a running test say that it is *ignored*: a machine that
//! lacks something shows it, and no test passes without having tested.

pub mod data;
pub mod display;
pub mod gpu;
pub mod headset;
pub mod image;
pub mod programs;
pub mod remote;
pub mod server;
pub mod slurm;
pub mod soak;

pub use measure::scene;
