//! [`Playing`]: cost and error of playing a clip.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::parameter::{Parameter, Quartiles};

/// Measurements of playing a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Playing {
    /// The device, and the work that was measured.
    pub setup: PlayingSetup,
    /// The parameters of the renderer.
    pub parameters: Vec<Parameter>,
    /// The optional features of clips.
    pub features: Vec<ClipFeature>,
    /// Pictures to compare, the reference's first.
    pub pictures: Vec<NamedPicture>,
}

/// The device, and the work that was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlayingSetup {
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Name and version of its driver.
    pub driver: String,
    /// Whether the fragment stage calculates in f16; else in f32.
    pub f16: bool,
    /// Whether the GPU times its work; otherwise drawing is the remainder of a frame.
    pub gpu_timed: bool,
    /// Width and height of the pictures in pixels.
    pub size: [u32; 2],
    /// Number of Gaussians of the clip, without the plate.
    pub gaussians: usize,
    /// Number of pictures behind errors, times and counts.
    pub pictures: usize,
    /// Number of frames of the turning head.
    pub turn_frames: usize,
    /// How often each picture was timed.
    pub rounds: usize,
    /// Number of steps of the measurement.
    pub steps: u64,
}

/// A picture of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedPicture {
    /// Name of its variant.
    pub name: String,
    /// PNG, in base 64.
    pub png: String,
}

/// An optional feature of clips, and what a clip saves without it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClipFeature {
    /// Its name.
    #[serde(rename = "part")]
    pub name: String,
    /// Whether this clip does without it.
    pub left_out: bool,
    /// What the clip needs of it.
    pub needs: String,
    /// How the measurement switched it on; empty where the clip needs it.
    pub switched_on: String,
    /// Costs of the clip without it.
    pub without: ResourceUse,
    /// Costs with it: switched on, or as the clip is where it needs the feature.
    pub with: ResourceUse,
}

/// Costs of a clip.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ResourceUse {
    /// Counts, the same on every machine.
    pub counts: BTreeMap<String, f64>,
    /// Milliseconds per frame.
    pub frame_ms: Option<Quartiles>,
}
