//! [`CaseResult`]: a measured case.

use serde::Serialize;

/// A case, measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseResult {
    /// What makes it hard.
    pub group: String,
    /// Its name.
    pub case: String,
    /// `holds` or `fails`.
    pub outcome: String,
    /// What was measured; nothing where it came to no number.
    pub deviation: Option<f64>,
    /// The most that is allowed.
    pub bound: f64,
    /// Unit of both.
    pub unit: String,
    /// What the encoder does with it: `taken`, and the deviation of a package by each coder;
    /// `refused` and why; or `not tried` and why.
    pub package: String,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Number of pictures.
    pub pictures: usize,
    /// Seconds that the GPU's pictures took.
    pub seconds: f64,
    /// Bytes that they took at most, of the heap and of GPU buffers.
    pub bytes: u64,
    /// How the renderer handles it.
    pub how: String,
    /// What is wrong, where it fails.
    pub problem: Option<String>,
}
