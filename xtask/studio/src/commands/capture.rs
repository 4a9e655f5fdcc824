//! Options of the commands that read a capture.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, Once, PoisonError};

use crate::capture::{BackgroundSource, CaptureFiles};
use crate::fit::{TrainingViews, file_crc};
use crate::lpips_weights::load_lpips;
use crate::messages::count;
use crate::parse::range;
use crate::scene::Scene;
use anyhow::bail;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use program::Fault;
use refine::capture::{Holdout, Split};
use refine::fit::Lpips;

use super::fit_source::FitSource;
use super::render;

/// The cameras, frames and pixels of a capture that a command reads, and the frames that it holds out.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct FrameSelection {
    #[command(flatten)]
    part: PartSelection,
    /// Frames that are held out from fitting, which a field records; by default none, and with a fitted field to judge or
    /// to refine those that it records
    #[arg(long, value_enum)]
    holdout: Option<HeldFrames>,
    /// Size in pixels to shrink the photographs to; their own by default
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
}

/// The cameras and frames of a capture that a command reads.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct PartSelection {
    /// Frames to read: from A up to, without, B; by default all, or those that a field records
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
    /// The frames that count as held out, if they are stated.
    pub(crate) fn holdout(&self) -> Option<Holdout> {
        self.holdout.map(Holdout::from)
    }

    /// The frames that a fit holds out.
    pub(crate) fn holdout_of_fit(&self) -> Holdout {
        self.holdout().unwrap_or(Holdout::None)
    }

    /// Opens a capture and applies the selection.
    pub(crate) fn open(&self, folder: &Path) -> anyhow::Result<CaptureFiles> {
        self.part.open(folder, self.size)
    }

    /// Opens the capture that `source` was fitted to, at the frames that it records, and applies the selection. `holdout`
    /// are the frames that count as held out.
    ///
    /// # Errors
    /// Those of [`Self::open`]; [`Fault::Usage`] if the capture has no such frames, has them at other times, or if
    /// the selection contradicts the record.
    pub(crate) fn open_for(
        &self,
        folder: &Path,
        source: &FitSource,
        holdout: Holdout,
    ) -> anyhow::Result<CaptureFiles> {
        let mut capture_files = self.part.open_fitted(folder, self.size, source)?;
        source.prepare(&mut capture_files, holdout)?;
        Ok(capture_files)
    }

    /// The photographs of the capture in `folder` to refine `scene` on, which was loaded from `path`: at the frames and
    /// with the holdout that its field records, or else with the holdout that is selected.
    ///
    /// # Errors
    /// Those of [`Self::open_for`].
    pub(crate) fn photographs_of(
        &self,
        folder: &Path,
        path: &Path,
        scene: &Scene,
    ) -> anyhow::Result<TrainingViews> {
        let source = FitSource::of_scene(path, scene);
        let (holdout, note) = source.held_frames(self.holdout());
        let mut capture_files = self.open_for(folder, &source, holdout)?;
        if scene.plate.is_some() && capture_files.background_source(holdout)? == BackgroundSource::Plates {
            // The field is refined before its plate, so photographs are compared as they are.
            capture_files.see_whole();
        }
        source.note_static(&capture_files);
        let views = load_training_views(&capture_files, holdout)?;
        if let Some(note) = note {
            eprintln!("note: {note}");
        }
        Ok(views)
    }

    /// Whether it selects all frames.
    pub(crate) fn is_whole(&self) -> bool {
        self.part.frames.is_none()
    }

    /// Whether it selects the whole capture.
    pub(crate) fn is_default(&self) -> bool {
        self.part.is_default() && self.size.is_none() && self.holdout.is_none()
    }
}

impl PartSelection {
    /// Opens a capture, applies the selection and shrinks the photographs to `size`.
    pub(crate) fn open(&self, folder: &Path, size: Option<(u32, u32)>) -> anyhow::Result<CaptureFiles> {
        self.open_with(folder, size, |capture_files| match &self.frames {
            Some(frames) => capture_files.keep_frames(frames.clone()),
            None => Ok(()),
        })
    }

    /// Opens the capture at the frames of `source`.
    fn open_fitted(
        &self,
        folder: &Path,
        size: Option<(u32, u32)>,
        source: &FitSource,
    ) -> anyhow::Result<CaptureFiles> {
        let FitSource { path, record, .. } = source;
        let Some(fitted) = &record.frames else {
            let capture_files = self.open(folder, size)?;
            source.check_count(&capture_files)?;
            return Ok(capture_files);
        };
        let Range { start, end } = fitted;
        if let Some(asked) = self.frames.as_ref().filter(|asked| *asked != fitted) {
            bail!(Fault::Usage(format!(
                "--frames {}..{}: {} was fitted to frames {start}..{end}; leave --frames out, or fit a field to yours",
                asked.start,
                asked.end,
                path.display()
            )));
        }
        self.open_with(folder, size, |capture_files| {
            let count = capture_files.capture.frames();
            capture_files.keep_fitted(record, path, folder)?;
            if self.frames.is_none() && *fitted != (0..count) {
                eprintln!(
                    "note: {} was fitted to frames {start}..{end}, so only these are used",
                    path.display()
                );
            }
            Ok(())
        })
    }

    fn open_with(
        &self,
        folder: &Path,
        size: Option<(u32, u32)>,
        keep_frames: impl FnOnce(&mut CaptureFiles) -> Result<(), Fault>,
    ) -> anyhow::Result<CaptureFiles> {
        let mut capture_files = CaptureFiles::open(folder)?;
        for note in std::mem::take(&mut capture_files.notes) {
            report_once(format!("{}: {note}", folder.display()));
        }
        if !self.cameras.is_empty() {
            capture_files.keep_cameras(&self.cameras)?;
        }
        for note in capture_files.picture_notes() {
            report_once(format!("{}: {note}", folder.display()));
        }
        keep_frames(&mut capture_files)?;
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

/// Reports a note on standard error, unless it was reported before: a command may open a capture several times.
fn report_once(note: String) {
    static REPORTED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut reported = REPORTED.lock().unwrap_or_else(PoisonError::into_inner);
    if reported.insert(note.clone()) {
        eprintln!("note: {note}");
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
    range(text).ok_or_else(|| "frames as 0..9".into())
}

fn size(text: &str) -> Result<(u32, u32), String> {
    render::size(text).map(<(u32, u32)>::from)
}
