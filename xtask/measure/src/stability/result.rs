//! [`CaseResult`]: the measurements of a case.

use serde::Serialize;

/// The measurements of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseResult {
    /// The kind of difficulty.
    pub group: String,
    /// Name of the case.
    pub case: String,
    /// `holds` or `fails`.
    pub outcome: String,
    /// The measured deviation; `None` if the measurement failed.
    pub deviation: Option<f64>,
    /// Largest allowed deviation.
    pub bound: f64,
    /// Unit of `deviation` and `bound`.
    pub unit: String,
    /// The encoder's result: `taken` and the deviation of a package by each coder, `refused` and the reason, or
    /// `not tried` and the reason.
    pub package: String,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Number of images.
    pub pictures: usize,
    /// Seconds of rendering on the GPU.
    pub seconds: f64,
    /// Peak memory of rendering in bytes, heap and GPU buffers together.
    pub bytes: u64,
    /// How the renderer handles the difficulty.
    pub how: String,
    /// The failure, if `outcome` is `fails`.
    pub problem: Option<String>,
}
