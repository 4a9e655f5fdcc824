//! Harness of the tests across crates.
//!
//! Tests that need a graphics device or a display run under [`libtest_mimic`], which prints like the
//! standard harness, but lets a running test report itself as *ignored*: no test passes without having
//! tested anything.

pub mod data;
pub mod display;
pub mod gpu;
pub mod headset;
pub mod image;
pub mod lossy;
pub mod outcome;
pub mod programs;
pub mod remote;
pub mod server;
pub mod slurm;
pub mod soak;
pub mod take_files;
pub mod takes;

pub use measure::scene;
