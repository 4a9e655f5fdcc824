//! [`FitPlan`]: the settings that determine the result of a fit, and their defaults.

use std::fs;
use std::path::Path;

use clap::ValueEnum;
use codec::PixelFilter;
use program::Fault;
use refine::anchor::Mirror;
use refine::capture::{CalibratedCamera, Focus, Holdout};
use refine::fit::{DensityRule, FRAGMENT_WEIGHT, FitSettings, Learned};
use serde::{Deserialize, Serialize};

use super::training_views::train_frames;
use crate::capture::CaptureFiles;
use crate::messages::{count, unreadable};

/// Default degree of view-dependent colour.
const SH_DEGREE: u8 = 3;

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
    /// Near distance of the field, [`codec::Field::near`].
    pub near: f64,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// Seed of the random numbers.
    pub seed: u64,
    /// What is learned of the cameras.
    pub learned: Learned,
    /// Whether gains are learned, too, where the cameras disagree about colours.
    pub learns_disagreement: bool,
    /// What becomes of the background.
    pub plate: PlatePlan,
    /// The first steps, on smaller photographs.
    pub coarse: Coarse,
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
    /// First a plate is fitted to the background, then both together to whole photographs. Mattes only place
    /// the first Gaussians of what moves.
    Fitted,
}

/// The first steps of a fit, on smaller photographs: they find the large shapes in a fraction of the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Coarse {
    /// Pixels are so many times as large.
    pub factor: u32,
    /// Number of these steps.
    pub steps: u64,
}

impl Coarse {
    /// No such steps.
    pub const NONE: Coarse = Coarse { factor: 1, steps: 0 };

    /// Half of `steps`, at a size of at most [`COARSE_PIXELS`].
    fn half_of(steps: u64, pixels: f64) -> Coarse {
        let factor =
            (0..).map(|power| 1 << power).find(|factor| pixels <= COARSE_PIXELS * f64::from(factor * factor));
        match factor.unwrap_or(1) {
            1 => Coarse::NONE,
            factor => Coarse { factor, steps: steps / 2 },
        }
    }
}

/// Most pixels of a photograph that the first steps compare.
const COARSE_PIXELS: f64 = 150_000.0;

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
    /// The default plan for a capture, whose background `plate` tells.
    ///
    /// # Errors
    /// [`Fault::Data`] if `holdout` leaves no photograph to fit to.
    pub fn default_for(
        capture_files: &CaptureFiles,
        holdout: Holdout,
        plate: PlatePlan,
    ) -> Result<FitPlan, Fault> {
        let frames = train_frames(capture_files, holdout)?.len();
        let plan = FitPlan { plate, ..FitPlan::for_frames(capture_files, holdout, frames) };
        if plate != PlatePlan::Fitted {
            return Ok(plan);
        }
        let gaussians = of_pixels(WHOLE_GAUSSIANS.min(WHOLE_GAUSSIANS_A_FRAME * frames), capture_files);
        Ok(FitPlan {
            steps: WHOLE_STEPS,
            gaussians,
            floor: gaussians,
            fragment_weight: default_fragment_weight(true),
            sh_degree: 0,
            ..plan
        })
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
            fragment_weight: default_fragment_weight(false),
            filter: PixelFilter::Mip,
            near: near(capture_files),
            sh_degree: SH_DEGREE,
            seed: 0,
            learned: capture_files.learned,
            learns_disagreement: capture_files.learned.is_nothing(),
            plate: PlatePlan::None,
            coarse: Coarse::NONE,
            holdout,
            lpips: None,
            capture: fingerprint(capture_files),
        }
    }

    /// This plan, with its first steps on smaller photographs if they are whole.
    pub fn with_coarse_steps(self, capture_files: &CaptureFiles) -> FitPlan {
        let coarse = match self.plate {
            PlatePlan::Fitted => Coarse::half_of(self.steps, largest_photograph(capture_files)),
            PlatePlan::None | PlatePlan::Mattes => Coarse::NONE,
        };
        FitPlan { coarse, ..self }
    }

    /// This plan, from `start`. A field has the large shapes already: its photographs stay as large as they are.
    pub fn starting_from(self, start: FitStart) -> FitPlan {
        let coarse = if matches!(start, FitStart::Field(..)) { Coarse::NONE } else { self.coarse };
        FitPlan { start, coarse, ..self }
    }

    /// Number of steps of the plate.
    pub fn plate_steps(&self) -> u64 {
        match self.start {
            // It has its plate.
            FitStart::Field(..) => 0,
            _ => PLATE_STEPS.min(self.steps),
        }
    }

    /// Whether gains of cameras are learned where these disagree about colours.
    pub fn asks_for_gains(&self) -> bool {
        self.learns_disagreement && self.plate == PlatePlan::Fitted
    }

    /// Whether what is learned of the colours of cameras starts from gains that are measured in whole photographs.
    pub(super) fn measures_gains(&self) -> bool {
        let is_learned = self.learned.gains || self.learned.colors;
        self.asks_for_gains() || (is_learned && self.plate == PlatePlan::Fitted)
    }

    /// What a fit of whole photographs does, in a line, after `done` of its steps, and how long that takes if it is on so many
    /// cores.
    pub fn describe_whole(&self, capture_files: &CaptureFiles, done: u64, cores: Option<usize>) -> String {
        let size = |factor: u32| {
            let cameras = capture_files.capture.cameras.iter().map(|camera| &camera.camera);
            let largest = cameras.max_by_key(|camera| u64::from(camera.width) * u64::from(camera.height));
            largest.map_or(String::new(), |camera| {
                format!("{}x{}", camera.width / factor, camera.height / factor)
            })
        };
        let Coarse { factor, steps: coarse } = self.coarse;
        let plate = if done == 0 { self.plate_steps() } else { 0 };
        let small = coarse.saturating_sub(done);
        let left = self.steps.saturating_sub(done);
        let pixels = largest_photograph(capture_files);
        let of_small = (plate + small) as f64 * (pixels / f64::from(factor * factor));
        let of_large = (left - small) as f64 * pixels;
        let time = cores.map_or(String::new(), |cores| {
            let minutes = (of_small + of_large) * CORE_S_A_PIXEL / cores as f64 / 60.0;
            let minutes = count(minutes.max(1.0).round() as usize, "minute");
            format!("; about {minutes} on {}", count(cores, "core"))
        });
        let first = match small {
            0 => String::new(),
            _ => format!(", the first {small} at {}", size(factor)),
        };
        let still = match plate {
            0 => String::new(),
            _ => format!("{plate} steps for what stands still, then "),
        };
        format!("whole photographs of {}: {still}{left} steps for all of it together{first}{time}", size(1))
    }

    /// The capture with the photographs that place the first Gaussians: the photographs of the first steps.
    pub fn start_files(&self, capture_files: &CaptureFiles) -> CaptureFiles {
        capture_files.coarser(self.coarse.factor)
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
            // What a fit goes on from was thinned.
            thins: self.plate == PlatePlan::Fitted && !matches!(self.start, FitStart::Field(..)),
            seed: self.seed,
            ..FitSettings::default()
        }
    }
}

/// Default number of steps for a number of training frames; the paper takes 96,000 for 17.
fn default_steps(frames: usize) -> u64 {
    (5_600 * frames as u64).min(96_000)
}

/// Default number of Gaussians for a number of training frames. The paper takes 200,000 for 17 frames of
/// 512x375 pixels; smaller photographs need fewer in proportion to their pixels.
pub(super) fn default_gaussians(frames: usize, capture_files: &CaptureFiles) -> usize {
    of_pixels((12_000 * frames).min(200_000), capture_files)
}

/// Seconds of a core that a step takes for each pixel of a whole photograph: 0.05 for 320x180.
const CORE_S_A_PIXEL: f64 = 0.9e-6;

/// Default number of steps for whole photographs, beside the steps of the plate: with these 16 minutes of two cores
/// at 640x360.
const WHOLE_STEPS: u64 = 13_000;

/// Most steps of a plate: it becomes part of a longer fit.
const PLATE_STEPS: u64 = 4000;

/// Default number of the first Gaussians of what moves in whole photographs of 512x375 pixels, and the most for a frame.
const WHOLE_GAUSSIANS: usize = 90_000;
const WHOLE_GAUSSIANS_A_FRAME: usize = 3000;

/// Default weight of the fragment term of fits and refinements. A room, in whole photographs, covers every pixel of a player
/// many times over, and what is wide in it is haze: at twice and three times [`FRAGMENT_WEIGHT`], held cameras of
/// panoptic-basketball at 320x180, 4000 steps, have 30.17 and 30.25 dB, and 26.39 and 26.32 dB where pixels move.
pub fn default_fragment_weight(is_whole: bool) -> f64 {
    if is_whole { 2.5 * FRAGMENT_WEIGHT } else { FRAGMENT_WEIGHT }
}

/// A number of Gaussians for photographs of 512x375 pixels, in proportion to the capture's pixels if these are fewer.
fn of_pixels(gaussians: usize, capture_files: &CaptureFiles) -> usize {
    let fraction = (largest_photograph(capture_files) / (512.0 * 375.0)).min(1.0);
    (fraction * gaussians as f64).ceil() as usize
}

/// Number of pixels of the largest photograph.
fn largest_photograph(capture_files: &CaptureFiles) -> f64 {
    let pixels = |camera: &CalibratedCamera| f64::from(camera.camera.width) * f64::from(camera.camera.height);
    capture_files.capture.cameras.iter().map(pixels).fold(0.0, f64::max)
}

/// The near distance of what the cameras that are fitted to look at; 0 if that is unknown.
fn near(capture_files: &CaptureFiles) -> f64 {
    let fitted = capture_files.capture.cameras.iter().filter(|camera| !camera.held);
    Focus::from_cameras(fitted.map(|camera| &camera.camera)).map_or(0.0, |focus| focus.near())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_steps_see_no_more_pixels_than_they_need() {
        let coarse = |pixels| Coarse::half_of(10_000, pixels);
        assert_eq!(coarse(320.0 * 180.0), Coarse::NONE);
        assert_eq!(coarse(COARSE_PIXELS), Coarse::NONE);
        assert_eq!(coarse(640.0 * 360.0), Coarse { factor: 2, steps: 5000 });
        assert_eq!(coarse(1920.0 * 1080.0), Coarse { factor: 4, steps: 5000 });
    }
}
