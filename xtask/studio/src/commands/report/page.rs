//! Measures one clip or field for its page.

use std::path::{Path, PathBuf};

use anyhow::Context;
use codec::Limits;
use glam::UVec2;
use measure::device::{Passes, device};
use measure::playing;

use crate::input::{is_package, read_package};
use crate::machine::machine;
use crate::package::{LAYERS, PackageSettings, package_with};
use crate::progress::StagedProgress;
use crate::report::fitting;
use crate::report::{Findings, ReportSubject, packaging};

/// Measures `path`, a package or a field, in pictures of this `size`, and reads the tables of its
/// fits: `logs`, or those beside it.
pub(super) fn measure(path: &Path, size: [u32; 2], logs: &[PathBuf]) -> anyhow::Result<Findings> {
    let subject = ReportSubject::load(path)?;
    let fits = fitting::load_all(path, logs)?;
    let progress = StagedProgress::visible();
    let bytes = if is_package(path) {
        read_package(path)?
    } else {
        package_with(&subject.scene, &PackageSettings::default(), None, &progress)?.bytes
    };
    let clip = codec::decode(&bytes, &Limits::default()).with_context(|| path.display().to_string())?;
    let gpu = device(Passes::Shared)?;
    let mut is_begun = false;
    let mut on_step = |name: &str, steps: u64| {
        if !is_begun {
            progress.stage("playing", steps as usize);
            is_begun = true;
        }
        progress.set_message(format!("playing: {name}"));
        progress.step();
    };
    let whole = subject.to_reference();
    let playing = playing::measure(gpu, &clip, &whole, UVec2::from(size), &LAYERS, &mut on_step)?;
    let packaging = packaging::measure(&subject, &progress)?;
    progress.finish();
    Ok(Findings { name: subject.scene.name, machine: machine(), playing, packaging, fits })
}
