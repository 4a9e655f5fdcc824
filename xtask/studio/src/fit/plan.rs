//! [`FitPlan`]: the settings that determine the result of a fit, and their defaults.

use std::fs;
use std::path::Path;

use clap::ValueEnum;
use codec::PixelFilter;
use program::Fault;
use refine::anchor::Mirror;
use refine::capture::{CalibratedCamera, Holdout};
use refine::fit::{DensityRule, FRAGMENT_WEIGHT, FitSettings, Learned};
use serde::{Deserialize, Serialize};

use super::training_views::train_frames;
use crate::capture::CaptureFiles;
use crate::messages::unreadable;

/// Default degree of view-dependent colour.
pub const SH_DEGREE: u8 = 3;

/// Settings that determine the result of a fit. A checkpoint with other settings is refused; the pixels
/// of photographs and depth maps are not compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitPlan {
    /// Steps to take.
    pub steps: u64,
    /// Source of the first Gaussians.
    pub start: FitStart,
    /// Names of the cameras whose pixels become Gaussians of the anchor; empty for all cameras.
    pub anchor_cameras: Vec<String>,
    /// When the anchor's back side is mirrored.
    pub mirror: Mirror,
    /// Whether the anchor's Gaussians start along the motion of the surface between frames.
    pub motion_start: bool,
    /// Approximate number of Gaussians of the anchor.
    pub gaussians: usize,
    /// Number of Gaussians below which pruning stops, the paper's `N_min`; 0 for no floor.
    pub floor: usize,
    /// How Gaussians are added and removed.
    pub rule: DensityRule,
    /// Weight of the fragment term, [`FitSettings::fragment_weight`]; 0 for none.
    pub fragment_weight: f64,
    /// The filter of the field.
    pub filter: PixelFilter,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// Seed of the random numbers.
    pub seed: u64,
    /// What is learned of the cameras.
    pub learned: Learned,
    /// What becomes of the background.
    pub plate: PlatePlan,
    /// Held-out frames.
    pub holdout: Holdout,
    /// Network and checksum of the LPIPS weights; `None` if the loss has no LPIPS term.
    pub lpips: Option<String>,
    /// Fingerprint of the selected part of the capture: number of cameras, frames and photographs, and a
    /// checksum of its cameras, times and names, plates included.
    pub capture: String,
}

/// Source of the first Gaussians.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FitStart {
    /// The visual hull of the masks.
    Hull,
    /// The visual hull, refined by plane sweep.
    Sweep,
    /// A folder of depth maps with the names of the photographs.
    Depths(String, DepthScale),
    /// Gaussians at random positions.
    Scatter,
    /// A fitted field or a package, with its checksum.
    Field(String, u32),
}

/// What a fit makes of the background of photographs without masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlatePlan {
    /// It belongs to the field.
    None,
    /// Photographs get mattes, so that the field is of the subject alone.
    Mattes,
    /// The same, and first a plate is fitted to what is behind the subject.
    Fitted,
}

/// How depth maps are scaled to the units of the cameras. The variants' docs are help texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
pub enum DepthScale {
    /// By the hull if masks carve one in every frame, else by the rig
    Auto,
    /// The maps are in units of the capture
    Metric,
    /// One factor for all maps: their median depth becomes the radius of the rig, as in the paper
    Rig,
    /// A factor and an offset for each map, fitted to the visual hull
    Hull,
}

impl FitPlan {
    /// The default plan for a capture.
    ///
    /// # Errors
    /// [`Fault::Data`] if `holdout` leaves no photograph to fit to.
    pub fn default_for(capture_files: &CaptureFiles, holdout: Holdout) -> Result<FitPlan, Fault> {
        let frames = train_frames(capture_files, holdout)?.len();
        Ok(FitPlan::for_frames(capture_files, holdout, frames))
    }

    /// The default plan for so many frames to fit to of a capture.
    fn for_frames(capture_files: &CaptureFiles, holdout: Holdout, frames: usize) -> FitPlan {
        let gaussians = default_gaussians(frames, capture_files);
        FitPlan {
            steps: default_steps(frames),
            start: FitStart::Sweep,
            anchor_cameras: Vec::new(),
            mirror: Mirror::Auto,
            motion_start: true,
            gaussians,
            floor: gaussians,
            rule: DensityRule::Floor,
            fragment_weight: FRAGMENT_WEIGHT,
            filter: PixelFilter::Mip,
            sh_degree: SH_DEGREE,
            seed: 0,
            learned: capture_files.learned,
            plate: PlatePlan::None,
            holdout,
            lpips: None,
            capture: fingerprint(capture_files),
        }
    }

    /// The default plan for `unit_s` seconds of a capture that lasts longer.
    ///
    /// # Errors
    /// Those of [`FitPlan::default_for`].
    pub fn default_for_seconds(
        capture_files: &CaptureFiles,
        holdout: Holdout,
        unit_s: f64,
    ) -> Result<FitPlan, Fault> {
        let frames = train_frames(capture_files, holdout)?.len() as f64;
        let frames = (frames * unit_s / capture_files.capture.duration_s()).round().max(1.0);
        Ok(FitPlan::for_frames(capture_files, holdout, frames as usize))
    }

    pub(super) fn fit_settings(&self) -> FitSettings {
        FitSettings {
            steps: self.steps,
            floor: self.floor,
            rule: self.rule,
            fragment_weight: self.fragment_weight,
            seed: self.seed,
            ..FitSettings::default()
        }
    }
}

/// Default number of steps for a number of training frames; the paper takes 96,000 for 17.
pub(super) fn default_steps(frames: usize) -> u64 {
    (5_600 * frames as u64).min(96_000)
}

/// Default number of Gaussians for a number of training frames. The paper takes 200,000 for 17 frames of
/// 512x375 pixels; smaller photographs need fewer in proportion to their pixels.
pub(super) fn default_gaussians(frames: usize, capture_files: &CaptureFiles) -> usize {
    let pixels = |camera: &CalibratedCamera| f64::from(camera.camera.width) * f64::from(camera.camera.height);
    let largest = capture_files.capture.cameras.iter().map(pixels).fold(0.0, f64::max);
    let fraction = (largest / (512.0 * 375.0)).min(1.0);
    (fraction * (12_000.0 * frames as f64).min(200_000.0)).ceil() as usize
}

/// CRC-32 of `bytes`.
pub fn crc(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// CRC-32 of a file.
///
/// # Errors
/// [`Fault::Data`] if it cannot be read.
pub fn file_crc(path: &Path) -> Result<u32, Fault> {
    fs::read(path).map(|bytes| crc(&bytes)).map_err(|error| unreadable(path, &error))
}

/// A text that differs between selections of captures.
fn fingerprint(capture_files: &CaptureFiles) -> String {
    let capture = &capture_files.capture;
    let mut crc = flate2::Crc::new();
    for camera in &capture.cameras {
        crc.update(format!("{camera:?}").as_bytes());
    }
    crc.update(format!("{:?}", capture.frame_times_s).as_bytes());
    for late_s in &capture.deviations_s {
        crc.update(&late_s.to_le_bytes());
    }
    for photo_id in &capture.photos {
        crc.update(capture_files.name(*photo_id).as_bytes());
    }
    for plate in capture_files.stated_plates() {
        crc.update(plate.as_os_str().as_encoded_bytes());
    }
    format!(
        "{} cameras, {} frames, {} photographs, {:08x}",
        capture.cameras.len(),
        capture.frames(),
        capture.photos.len(),
        crc.sum()
    )
}
