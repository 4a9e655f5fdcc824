//! Measures one clip or field for its page.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::input::is_package;
use crate::machine::machine;
use crate::package::{self, package_showing};
use crate::report::fitting;
use crate::report::playing::{Message, Playing};
use crate::report::{Findings, Subject, packaging};
use anyhow::Context;

use super::{bar, program};

/// Measures `path`, a package or a field, in pictures of this `size`; with it the fits whose tables
/// are `logs`, or else lie beside it.
pub(super) fn measure(path: &Path, size: [u32; 2], logs: &[PathBuf]) -> anyhow::Result<Findings> {
    let subject = Subject::load(path)?;
    let fits = fitting::load_all(path, logs)?;
    let folder = tempfile::tempdir()?;
    let clip = if is_package(path) {
        path.to_owned()
    } else {
        let bar = bar("packaging")?;
        let package = package_showing(&subject.scene, &package::Settings::default(), None, &bar)?;
        bar.finish_and_clear();
        let clip = folder.path().join("clip.aarc");
        std::fs::write(&clip, package.bytes)?;
        clip
    };
    let playing = play(&clip, path, size)?;
    let bar = bar("packaging")?;
    bar.set_length(packaging::work(&subject));
    let packaging = packaging::measure(&subject, &bar)?;
    bar.finish_and_clear();
    Ok(Findings { name: subject.scene.name, machine: machine(), playing, packaging, fits })
}

/// Plays `clip`, which stands for `whole`.
fn play(clip: &Path, whole: &Path, [width, height]: [u32; 2]) -> anyhow::Result<Playing> {
    let bar = bar("playing")?;
    let mut playing: Option<Playing> = None;
    let args: [OsString; 3] = [clip.into(), whole.into(), format!("{width}x{height}").into()];
    program::run("playing", "release", args, |line| {
        match (serde_json::from_str(line)?, &mut playing) {
            (Message::Begin(setup), _) => {
                bar.set_length(setup.steps);
                playing = Some(Playing::begin(setup));
            }
            (Message::Step(what), _) => {
                bar.inc(1);
                bar.set_message(what);
            }
            (message, Some(playing)) => playing.add(message),
            (_, None) => {}
        }
        Ok(())
    })?;
    bar.finish_and_clear();
    playing.context("nothing was measured")
}
