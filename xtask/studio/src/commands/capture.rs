//! Options of the commands that read a capture.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Once;

use crate::capture::CaptureFiles;
use crate::fit::{TrainingViews, file_crc};
use crate::lpips_weights::load_lpips;
use crate::messages::count;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use program::Fault;
use refine::capture::{Holdout, Split};
use refine::fit::Lpips;

/// The cameras, frames and pixels of a capture that a command reads.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct FrameSelection {
    #[command(flatten)]
    part: PartSelection,
    /// Size in pixels to shrink the photographs to; their own by default
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
}

/// The cameras and frames of a capture that a command reads.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct PartSelection {
    /// Frames to read: from A up to, without, B; all by default
    #[arg(long, value_name = "A..B", value_parser = frames)]
    frames: Option<Range<usize>>,
    /// Cameras that are held out from fitting, by name, in addition to those the capture holds out
    #[arg(long, value_name = "NAME[,NAME..]", value_delimiter = ',')]
    held_cameras: Vec<String>,
    /// Cameras to read, by name; all by default
    #[arg(long, value_name = "NAME[,NAME..]", value_delimiter = ',')]
    cameras: Vec<String>,
}

/// Frames held out from fitting, on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum HeldFrames {
    /// No frame: the fit uses all
    None,
    /// Every other frame, from the second, for evaluation
    Odd,
}

impl From<HeldFrames> for Holdout {
    fn from(held: HeldFrames) -> Holdout {
        match held {
            HeldFrames::None => Holdout::None,
            HeldFrames::Odd => Holdout::Odd,
        }
    }
}

impl FrameSelection {
    /// Opens a capture and applies the selection.
    pub(crate) fn open(&self, folder: &Path) -> anyhow::Result<CaptureFiles> {
        self.part.open(folder, self.size)
    }

    /// Whether it selects the whole capture.
    pub(crate) fn is_default(&self) -> bool {
        self.part.is_default() && self.size.is_none()
    }
}

impl PartSelection {
    /// Opens a capture, applies the selection and shrinks the photographs to `size`.
    pub(crate) fn open(&self, folder: &Path, size: Option<(u32, u32)>) -> anyhow::Result<CaptureFiles> {
        let mut capture_files = CaptureFiles::open(folder)?;
        if !self.cameras.is_empty() {
            capture_files.keep_cameras(&self.cameras)?;
        }
        if let Some(frames) = &self.frames {
            capture_files.keep_frames(frames.clone())?;
        }
        if let Some((width, height)) = size {
            capture_files.shrink(width, height)?;
        }
        for name in &self.held_cameras {
            let index = capture_files.camera(name).map_err(|fault| fault.about("--held-cameras"))?;
            capture_files.capture.cameras[index].held = true;
        }
        Ok(capture_files)
    }

    /// Whether it selects all cameras and frames.
    pub(crate) fn is_default(&self) -> bool {
        self.frames.is_none() && self.held_cameras.is_empty() && self.cameras.is_empty()
    }
}

/// The number of cameras and frames, and of photographs in each split, in one line.
pub(crate) fn describe(capture_files: &CaptureFiles, holdout: Holdout) -> Result<String, Fault> {
    let cameras = &capture_files.capture.cameras;
    let splits =
        Split::assign(&capture_files.capture, holdout).map_err(|error| Fault::Data(error.to_string()))?;
    let [train, interp_b, recon, interp_a] =
        Split::ALL.map(|split| splits.iter().filter(|(_, of)| *of == split).count());
    Ok(format!(
        "{}, {} of them held; {}; {} to fit to, {} held out: {interp_b} of held frames, {recon} of held cameras, \
         {interp_a} of both",
        count(cameras.len(), "camera"),
        cameras.iter().filter(|camera| camera.held).count(),
        count(capture_files.capture.frames(), "frame"),
        count(train, "photograph"),
        interp_b + recon + interp_a,
    ))
}

/// Decodes the photographs for a fit, with a progress bar.
pub(crate) fn load_training_views(
    capture_files: &CaptureFiles,
    holdout: Holdout,
) -> anyhow::Result<TrainingViews> {
    let style = ProgressStyle::with_template("{spinner} {pos} photographs")?;
    let bar = ProgressBar::new_spinner().with_style(style);
    let views = TrainingViews::load(capture_files, holdout, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(views)
}

/// The weights of LPIPS.
#[derive(clap::Args, Clone, Debug, Default)]
pub(crate) struct LpipsOption {
    /// Weights of LPIPS, which is left out without them: torchvision's vgg16-397923af.pth or
    /// alexnet-owt-7be5be79.pth from download.pytorch.org/models, a comma, and vgg.pth or alex.pth from
    /// lpips/weights/v0.1 of the lpips package; or safetensors with the same tensors
    #[arg(long, value_name = "TRUNK,HEADS", value_delimiter = ',')]
    pub(crate) lpips_weights: Vec<PathBuf>,
}

impl LpipsOption {
    /// Loads the network if its weights are given.
    pub(crate) fn load(&self) -> Result<Option<Lpips<f32>>, Fault> {
        match &self.lpips_weights[..] {
            [] => Ok(None),
            files => load_lpips(files).map(Some),
        }
    }

    /// Names and checksums of the files, for the plan of a fit.
    pub(crate) fn record(&self) -> Result<Option<String>, Fault> {
        let name = |path: &PathBuf| Ok(format!("{}, {:08x}", path.display(), file_crc(path)?));
        let names = self.lpips_weights.iter().map(name).collect::<Result<Vec<_>, Fault>>()?;
        Ok((!names.is_empty()).then(|| names.join(" and ")))
    }
}

/// Where a command looks for the holdout of a fit, for [`held_frames`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct HoldoutRecord {
    /// The holdout, if one is recorded.
    pub(crate) recorded: Option<Holdout>,
    /// What would record it, for the note: "this field", "a package".
    pub(crate) source: &'static str,
}

/// The frames held out from fitting `path`: those that `--holdout` names, else those that are recorded, else
/// none. The second value is a note for the user if nothing is recorded, or something else than named.
pub(crate) fn held_frames(
    path: &Path,
    named: Option<HeldFrames>,
    record: HoldoutRecord,
) -> (Holdout, Option<String>) {
    let (path, source) = (path.display(), record.source);
    match (named.map(Holdout::from), record.recorded) {
        (Some(named), Some(recorded)) if named != recorded => {
            (named, Some(format!("{path} was fitted with --holdout {}", recorded.name())))
        }
        (Some(holdout), _) | (None, Some(holdout)) => (holdout, None),
        (None, None) => {
            let note = format!(
                "{path}: {source} records no holdout, so no frame counts as held out; --holdout names the frames \
                 that the fit held out"
            );
            (Holdout::None, Some(note))
        }
    }
}

/// Reports on standard error that the frame rate of a capture of several frames is assumed, if nothing states it,
/// with `remedy`, how to state it. Only the first call for such a capture reports.
pub(crate) fn note_assumed_fps(capture_files: &CaptureFiles, remedy: &str) {
    static REPORT: Once = Once::new();
    if capture_files.stated_fps.is_none() && capture_files.capture.frames() > 1 {
        let fps = capture_files.fps();
        REPORT.call_once(|| eprintln!("note: {fps} frames per second are assumed; {remedy}"));
    }
}

fn frames(text: &str) -> Result<Range<usize>, String> {
    let parts = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    parts.filter(|range: &Range<usize>| !range.is_empty()).ok_or_else(|| "frames as 0..9".into())
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parts.filter(|(w, h)| *w > 0 && *h > 0).ok_or_else(|| "width and height as 512x375".into())
}
