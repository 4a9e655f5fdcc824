//! Measures one field for its page.

use std::path::Path;

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
pub(super) const SIZE: [u32; 2] = [512, 384];

/// Measures a field, or a package or field folder of one segment, in pictures of `size`, and reads the tables of its fits.
pub(super) fn measure(path: &Path, size: [u32; 2]) -> anyhow::Result<Findings> {
    let subject = ReportSubject::load(path)?;
    let fits = fitting::load_beside(path)?;
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
    let playing = playing::measure(gpu, &clip, &whole, UVec2::from(size), &LAYERS, &mut on_step)?;
    let packaging = packaging::measure(&subject, &progress)?;
    progress.finish();
    Ok(Findings { name: subject.scene.name, machine: machine(), playing, packaging, fits })
}
