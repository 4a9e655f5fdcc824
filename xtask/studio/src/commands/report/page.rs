//! Measures one clip or field for its page.

use std::path::{Path, PathBuf};

use anyhow::Context;
use codec::Limits;
use glam::UVec2;
use measure::device::{Passes, device};
use measure::playing;

use super::bar;
use crate::input::{is_package, read_package};
use crate::machine::machine;
use crate::package::{self, LAYERS, package_showing};
use crate::report::fitting;
use crate::report::{Findings, Subject, packaging};

/// Measures `path`, a package or a field, in pictures of this `size`, and reads the tables of its
/// fits: `logs`, or those beside it.
pub(super) fn measure(path: &Path, size: [u32; 2], logs: &[PathBuf]) -> anyhow::Result<Findings> {
    let subject = Subject::load(path)?;
    let fits = fitting::load_all(path, logs)?;
    let bytes = if is_package(path) {
        read_package(path)?
    } else {
        let bar = bar("packaging")?;
        let package = package_showing(&subject.scene, &package::Settings::default(), None, &bar)?;
        bar.finish_and_clear();
        package.bytes
    };
    let clip = codec::decode(&bytes, &Limits::default()).with_context(|| path.display().to_string())?;
    let bar_of_playing = bar("playing")?;
    let mut on_step = |name: &str, steps: u64| {
        bar_of_playing.set_length(steps);
        bar_of_playing.inc(1);
        bar_of_playing.set_message(name.to_owned());
    };
    let gpu = device(Passes::Shared)?;
    let whole = subject.to_reference();
    let playing = playing::measure(gpu, &clip, &whole, UVec2::from(size), &LAYERS, &mut on_step)?;
    bar_of_playing.finish_and_clear();
    let bar = bar("packaging")?;
    bar.set_length(packaging::work(&subject));
    let packaging = packaging::measure(&subject, &bar)?;
    bar.finish_and_clear();
    Ok(Findings { name: subject.scene.name, machine: machine(), playing, packaging, fits })
}
