//! [`CameraPart`]: what a fit can learn of a camera, by the names of the manifest and of the command line.

use clap::ValueEnum;
use refine::fit::Learned;
use serde::Deserialize;

/// What a fit can learn of a camera. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum CameraPart {
    /// When it takes its photographs, against the first camera
    Offsets,
    /// Gain and offset of each of its colour channels, and its vignette
    Gains,
    /// An affine transform of its colours, and its vignette
    Colors,
    /// The exposure of each photograph
    Exposures,
    /// Small corrections of its pose
    Poses,
    /// Small corrections of its focal length
    Focals,
}

impl CameraPart {
    /// All of `parts`.
    pub fn learned(parts: &[CameraPart]) -> Learned {
        let has = |part| parts.contains(&part);
        Learned {
            offsets: has(CameraPart::Offsets),
            gains: has(CameraPart::Gains),
            colors: has(CameraPart::Colors),
            exposures: has(CameraPart::Exposures),
            poses: has(CameraPart::Poses),
            focals: has(CameraPart::Focals),
        }
    }
}
