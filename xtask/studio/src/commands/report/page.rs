//! Measures one field for its page.

use std::path::{Path, PathBuf};

use anyhow::bail;
use codec::Limits;
use formats::is_package;
use glam::UVec2;
use measure::device::{Fragments, Passes, device};
use measure::playing;
use program::Fault;
use refine::fit::Cpu;

use crate::commands::capture::PartSelection;
use crate::fit::TrainingViews;
use crate::machine::machine;
use crate::package::{LAYERS, PackageSettings, package_with};
use crate::progress::StagedProgress;
use crate::report::fitting;
use crate::report::{Findings, ReportSubject, packaging};
use crate::segments::TakeFile;

/// Default size of the measured pictures.
const SIZE: [u32; 2] = [512, 384];

/// What a page is made of.
pub(super) struct Request<'a> {
    /// A field, or a package or field folder of one segment.
    pub(super) path: &'a Path,
    /// Size of the measured pictures, and of the photographs of a refinement.
    pub(super) size: Option<[u32; 2]>,
    /// Tables of its fits; the tables beside it if there are none.
    pub(super) logs: &'a [PathBuf],
    /// Folder of its capture, and number of steps to refine it for.
    pub(super) refinement: Option<(&'a Path, u64)>,
    /// The cameras and frames of the capture.
    pub(super) part: &'a PartSelection,
}

/// Measures a package or a field, and reads the tables of its fits.
pub(super) fn measure(request: &Request) -> anyhow::Result<Findings> {
    let Request { path, size, logs, refinement, .. } = *request;
    let subject = ReportSubject::load(path)?;
    let fits = fitting::load_all(path, logs)?;
    let photographs = refinement.map(|(folder, _)| photographs(request, folder, &subject)).transpose()?;
    let progress = StagedProgress::visible();
    let clip = if is_package(path) {
        TakeFile::open(path)?.decode(0)?
    } else {
        let (settings, mut backend) = (PackageSettings::default(), Cpu::default());
        let package = package_with(&subject.scene, &settings, None, &mut backend, &progress)?;
        codec::decode(&package.bytes, &Limits::default())?
    };
    let gpu = device(Passes::Shared, Fragments::AsPlayers)?;
    let mut is_begun = false;
    let mut on_step = |name: &str, steps: u64| {
        if !is_begun {
            progress.stage("playing", steps as usize);
            is_begun = true;
        }
        progress.say(&format!("playing: {name}"));
        progress.step();
    };
    let whole = subject.to_reference();
    let playing =
        playing::measure(gpu, &clip, &whole, UVec2::from(size.unwrap_or(SIZE)), &LAYERS, &mut on_step)?;
    let refinement = photographs.as_ref().zip(refinement.map(|(_, steps)| steps));
    let packaging = packaging::measure(&subject, refinement, &progress)?;
    progress.finish();
    Ok(Findings { name: subject.scene.name, machine: machine(), playing, packaging, fits })
}

/// The photographs of the capture in `folder` for the refinements of `subject`.
///
/// # Errors
/// [`Fault::Usage`] if none is held out: those that a loss compares with do not say what a field is worth.
fn photographs(request: &Request, folder: &Path, subject: &ReportSubject) -> anyhow::Result<TrainingViews> {
    let Request { path, part, .. } = request;
    let size = request.size.map(|[width, height]| (width, height));
    let views = part.photographs_of(folder, size, path, &subject.scene, None)?;
    if views.held.is_empty() {
        let (field, capture) = (path.display(), folder.display());
        bail!(Fault::Usage(format!(
            "--refine: no photograph of {capture} is held out from {field}, so none can judge; name cameras with \
             --held-cameras, or fit a field with --holdout odd"
        )));
    }
    Ok(views)
}
