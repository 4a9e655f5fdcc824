//! Measures one field for its page.

use std::path::{Path, PathBuf};

use codec::Limits;
use formats::is_package;
use glam::UVec2;
use measure::device::{Fragments, Passes, device};
use measure::playing;
use refine::fit::Cpu;

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
    /// Size of the measured pictures.
    pub(super) size: Option<[u32; 2]>,
    /// Tables of its fits; the tables beside it if there are none.
    pub(super) logs: &'a [PathBuf],
}

/// Measures a package or a field, and reads the tables of its fits.
pub(super) fn measure(request: &Request) -> anyhow::Result<Findings> {
    let Request { path, size, logs } = *request;
    let subject = ReportSubject::load(path)?;
    let fits = fitting::load_all(path, logs)?;
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
    let packaging = packaging::measure(&subject, &progress)?;
    progress.finish();
    Ok(Findings { name: subject.scene.name, machine: machine(), playing, packaging, fits })
}
