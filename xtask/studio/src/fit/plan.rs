//! [`FitPlan`]: the settings that determine the result of a fit, and their defaults.

use program::Fault;
use refine::anchor::Mirror;
use refine::capture::{CalibratedCamera, Holdout};
use refine::fit::{DensityRule, FitSettings};
use serde::{Deserialize, Serialize};

use super::shots::train_frames;
use crate::capture::Footage;

/// Degree of view-dependent colour, unless told otherwise.
pub const SH_DEGREE: u8 = 3;

/// What decides what a fit ends as, so that a checkpoint of other settings is refused. The pixels of
/// photographs and depth maps are not compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Steps to take.
    pub steps: u64,
    /// What the fit starts from.
    pub start: Start,
    /// Names of the cameras whose pixels an anchor puts Gaussians at; all where none is named.
    pub anchor_cameras: Vec<String>,
    /// When an anchor's back side is mirrored.
    pub mirror: Mirror,
    /// Gaussians that the anchor makes about.
    pub gaussians: usize,
    /// Fewest Gaussians that pruning leaves, the paper's `N_min`; 0 for no floor.
    pub floor: usize,
    /// How Gaussians are made and removed.
    pub rule: DensityRule,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// Seed of all chance.
    pub seed: u64,
    /// The frames that are held out.
    pub holdout: Holdout,
    /// Network and checksum of the weights of LPIPS, where that is a part of the loss.
    pub lpips: Option<String>,
    /// Of the capture as it is cut and shrunk: cameras, frames, photographs and pixels, and a checksum
    /// of its cameras.
    pub capture: String,
}

/// What a fit starts from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Start {
    /// The visual hull of the masks.
    Hull,
    /// The visual hull, refined by plane sweep.
    Sweep,
    /// Depth maps in a folder, named as the photographs are.
    Depths(String, DepthScale),
    /// Nothing: Gaussians anywhere.
    Scatter,
    /// A fitted field or a package, and a checksum of it.
    Field(String, u32),
}

/// How depth maps come to the scale of the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DepthScale {
    /// [`DepthScale::Hull`] where masks carve a hull in every frame, else [`DepthScale::Rig`].
    Auto,
    /// They are in units of the capture.
    Metric,
    /// One factor for all: their median becomes the radius of the rig (the paper's rule).
    Rig,
    /// A factor and an offset for each, by which it fits the visual hull.
    Hull,
}

impl Settings {
    /// What is done with a capture where nothing is said.
    ///
    /// # Errors
    /// [`Fault::Data`] where nothing is left to fit to.
    pub fn usual(footage: &Footage, holdout: Holdout) -> Result<Settings, Fault> {
        let frames = train_frames(footage, holdout)?.len();
        let gaussians = usual_gaussians(frames, footage);
        Ok(Settings {
            steps: usual_steps(frames),
            start: Start::Sweep,
            anchor_cameras: Vec::new(),
            mirror: Mirror::Auto,
            gaussians,
            floor: gaussians,
            rule: DensityRule::Floor,
            sh_degree: SH_DEGREE,
            seed: 0,
            holdout,
            lpips: None,
            capture: fingerprint(footage),
        })
    }

    pub(super) fn of_fit(&self) -> FitSettings {
        FitSettings {
            steps: self.steps,
            floor: self.floor,
            rule: self.rule,
            seed: self.seed,
            ..FitSettings::default()
        }
    }
}

/// Steps for so many frames that are fitted to: the paper takes 96,000 for 17.
fn usual_steps(frames: usize) -> u64 {
    (5_600 * frames as u64).min(96_000)
}

/// Gaussians for so many frames that are fitted to: the paper takes 200,000 for 17 frames of 512x375
/// pixels. Smaller photographs show less.
fn usual_gaussians(frames: usize, footage: &Footage) -> usize {
    let pixels = |camera: &CalibratedCamera| f64::from(camera.camera.width) * f64::from(camera.camera.height);
    let largest = footage.capture.cameras.iter().map(pixels).fold(0.0, f64::max);
    let part = (largest / (512.0 * 375.0)).min(1.0);
    (part * (12_000.0 * frames as f64).min(200_000.0)).ceil() as usize
}

/// A checksum.
pub fn crc(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// What tells a capture, as it is cut and shrunk, from another.
fn fingerprint(footage: &Footage) -> String {
    let capture = &footage.capture;
    let mut crc = flate2::Crc::new();
    for camera in &capture.cameras {
        crc.update(format!("{camera:?}").as_bytes());
    }
    crc.update(format!("{:?}", capture.times).as_bytes());
    for shot in &capture.photos {
        crc.update(footage.name(*shot).as_bytes());
    }
    format!(
        "{} cameras, {} frames, {} photographs, {:08x}",
        capture.cameras.len(),
        capture.times.len(),
        capture.photos.len(),
        crc.sum()
    )
}
