//! [`FitSource`]: what a field, a package or a folder of pictures says of the photographs that it was fitted to.

use std::path::Path;

use program::Fault;
use refine::capture::Holdout;

use crate::capture::{BackgroundSource, CameraCorrections, CaptureFiles};
use crate::fields::FitRecord;
use crate::input::Input;
use crate::messages::count;
use crate::scene::{Scene, learned_cameras_of};

/// A field, a package or a folder of pictures, which may record the photographs that it was fitted to.
#[derive(Clone, Debug)]
pub(crate) struct FitSource<'a> {
    pub(super) path: &'a Path,
    pub(super) record: FitRecord,
    /// Number of captured frames of its clip, if known.
    frames: Option<usize>,
    is_static: bool,
    /// Whether it draws the background, too.
    pub(super) has_plate: bool,
}

impl<'a> FitSource<'a> {
    /// A field or package that was loaded from `path`.
    pub(crate) fn new(path: &'a Path, input: &Input) -> FitSource<'a> {
        FitSource {
            path,
            record: input.fit_record(),
            frames: input.frames(),
            is_static: input.is_static(),
            has_plate: input.has_plate(),
        }
    }

    /// A scene that was loaded from `path`.
    pub(crate) fn of_scene(path: &'a Path, scene: &Scene) -> FitSource<'a> {
        let Scene { subject, .. } = scene;
        FitSource {
            path,
            record: scene.fit_record(),
            frames: scene.frames(),
            is_static: subject.field.temporal.is_none(),
            has_plate: scene.plate.is_some(),
        }
    }

    /// A folder of pictures.
    pub(crate) fn of_pictures(path: &'a Path) -> FitSource<'a> {
        let record = FitRecord::default();
        FitSource { path, record, frames: None, is_static: false, has_plate: false }
    }

    /// Checks that the clip has as many frames as the capture: otherwise windows and trajectories would stand for
    /// other times. A static field is the same at all of them.
    pub(super) fn check_count(&self, capture_files: &CaptureFiles) -> Result<(), Fault> {
        let (name, capture_frames) = (self.path.display(), capture_files.capture.frames());
        match self.frames {
            Some(frames) if frames != capture_frames && !self.is_static => Err(Fault::Usage(format!(
                "{name} is of {} (duration_s times fps), the capture of {capture_frames}; select its frames with \
                 --frames",
                count(frames, "frame")
            ))),
            _ => Ok(()),
        }
    }

    /// Corrects the cameras of the capture by those that were learned with it, and gives photographs without masks mattes, if
    /// those had them that it was fitted to.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file of cameras; the errors of [`CaptureFiles::find_plates`].
    pub(crate) fn prepare(&self, capture_files: &mut CaptureFiles, holdout: Holdout) -> anyhow::Result<()> {
        capture_files.check_origin(&self.record, &self.path.display().to_string())?;
        if let Some(learned) = learned_cameras_of(self.path) {
            capture_files.correct(&CameraCorrections::read(&learned)?, &learned)?;
            eprintln!("note: cameras are as {} has them", learned.display());
        }
        self.find_mattes(capture_files, holdout)
    }

    /// Gives photographs without masks mattes, if those had them that it was fitted to.
    ///
    /// # Errors
    /// Those of [`CaptureFiles::find_plates`].
    fn find_mattes(&self, capture_files: &mut CaptureFiles, holdout: Holdout) -> anyhow::Result<()> {
        // A plate of another program's field tells as much as a record.
        let is_matted = self.record.has_mattes
            || (self.has_plate && capture_files.background_source(holdout)? == BackgroundSource::Plates);
        if is_matted {
            capture_files.find_plates(holdout)?;
        }
        Ok(())
    }

    /// Reports on standard error that a static field stays so in a fit to several frames.
    pub(crate) fn note_static(&self, capture_files: &CaptureFiles) {
        if self.is_static && capture_files.capture.frames() > 1 {
            eprintln!("note: {} does not move, so the fit keeps it static", self.path.display());
        }
    }

    /// The frames held out from fitting: those that `--holdout` has `named`, else those that are recorded, else none. The
    /// second value is a note for the user if nothing is recorded, or something else than named.
    pub(crate) fn held_frames(&self, named: Option<Holdout>) -> (Holdout, Option<String>) {
        let path = self.path.display();
        match (named, self.record.holdout) {
            (Some(named), Some(recorded)) if named != recorded => {
                (named, Some(format!("{path} was fitted with --holdout {}", recorded.name())))
            }
            (Some(holdout), _) | (None, Some(holdout)) => (holdout, None),
            (None, None) => {
                let note = format!(
                    "{path} records no holdout, so no frame counts as held out; --holdout names the frames that the \
                     fit held out"
                );
                (Holdout::None, Some(note))
            }
        }
    }
}
