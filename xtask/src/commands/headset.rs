//! `cargo xtask headset`: plays clips in a headset from several distances and prints a table of what it measured, in
//! Markdown for an issue.
//!
//! A row is printed and written as soon as its run ends, so an interrupted measurement keeps the finished ones. `adb`
//! reaches a headset, `local` a runtime on this machine; both only play, as `target` says. `table` reads what the
//! player measured, `clocks` what the runtime logs.

mod adb;
mod clocks;
mod device;
mod local;
mod table;
mod target;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::Context;
use program::{Fault, counted, output, read_error};
use xtask::workspace;

use self::device::Device;
use self::local::Local;
use self::table::Table;
use self::target::{Run, Target};

/// The APK to install, where `cargo xtask apk` writes it.
const APK: &str = "aarc.apk";

/// Where the viewer stands, by the player's options.
const DISTANCES: [&str; 3] = ["near", "standing", "inside"];

/// Gaussians of the clips that are played beside the whole demo.
const BUDGETS: [&str; 2] = ["20000", "10000"];

/// Play clips in a headset and print a table of its frame rates to paste into an issue
///
/// Installs aarc.apk, a development build, as only those write statistics, on the headset that adb finds, plays every clip from three distances, and removes the clips again.
/// ANDROID_SERIAL chooses among several headsets. client/HEADSET.md says what the table means.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Packages to play [default: the demo, and the demo cut to 20,000 and 10,000 Gaussians]
    clips: Vec<PathBuf>,

    /// Seconds to measure of each clip from each distance
    #[arg(long, value_name = "S", value_parser = seconds, default_value = "60")]
    seconds: f64,

    /// Measure on this machine's OpenXR runtime instead, with this player
    #[arg(long, value_name = "PROGRAM")]
    player: Option<PathBuf>,

    /// Folder to write: the table, and the player's statistics of each run
    #[arg(short, long, value_name = "DIR", default_value = "out/headset")]
    out: PathBuf,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| *number > 0.0 && *number <= 86_400.0);
    number.ok_or_else(|| "not a number of seconds up to 86,400, a day".into())
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    output::check_folder(&args.out)?;
    let missing = |path: &Path, error| Fault::Data(format!("{}: {}", path.display(), read_error(&error)));
    for clip in &args.clips {
        fs::File::open(clip).map_err(|error| missing(clip, error))?;
    }
    if let Some(player) = &args.player {
        return measure(args, &clips(args)?, &Local { player: player.clone() });
    }
    if !Path::new(APK).is_file() {
        return Err(
            Fault::Data(format!("{APK}: there is no such file: make it as client/HEADSET.md says")).into()
        );
    }
    let device = Device::find()?;
    let clips = clips(args)?;
    device.install(Path::new(APK))?;
    let result = measure(args, &clips, &device);
    device.clean();
    result
}

/// Plays every clip from every distance and writes the table row by row.
fn measure(args: &Args, clips: &[PathBuf], target: &impl Target) -> anyhow::Result<()> {
    output::make_folder(&args.out)?;
    let (mut table, path) = (Table::new(args.seconds), args.out.join("table.md"));
    let runs = clips.iter().enumerate().flat_map(|clip| DISTANCES.map(|distance| (clip, distance)));
    for ((number, clip), distance) in runs {
        let name = clip.file_stem().unwrap_or_default().to_string_lossy();
        eprintln!("playing {name}, {distance}");
        let played = target.play(&Run { clip, distance, seconds: args.seconds });
        let played = played.map_err(|fault| unfinished(fault, table.len(), &path))?;
        table.add(&name, distance, &played)?;
        output::write(&args.out.join(format!("{}-{name}-{distance}.json", number + 1)), &played.stats)?;
        output::write(&path, table.text().as_bytes())?;
        print!("{}", table.latest());
    }
    eprintln!("the table is in {}", path.display());
    Ok(())
}

/// The fault that ended a measurement, with the number and the file of its finished rows.
fn unfinished(fault: Fault, rows: usize, path: &Path) -> Fault {
    match (rows, fault) {
        (1.., Fault::Device(message)) => {
            let rows = counted(rows, "finished row");
            Fault::Device(format!("{message}; the {rows} so far: {}", path.display()))
        }
        (_, fault) => fault,
    }
}

/// The clips to play.
fn clips(args: &Args) -> anyhow::Result<Vec<PathBuf>> {
    if !args.clips.is_empty() {
        return Ok(args.clips.clone());
    }
    let folder = workspace::target_folder().join("headset");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let field = folder.join("demo.ply");
    studio(&["synth".into(), "clip".into(), "-o".into(), field.clone().into()])?;
    let mut clips = vec![workspace::root().join("assets/demo.aarc")];
    for budget in BUDGETS {
        let clip = folder.join(format!("demo-{budget}.aarc"));
        let line = ["package".into(), field.clone().into(), "--budget".into(), budget.into(), "-o".into()];
        studio(&[&line[..], &[clip.clone().into()]].concat())?;
        clips.push(clip);
    }
    Ok(clips)
}

/// Runs a command of the host tool, whose messages go to standard error: standard output is the table's.
fn studio(args: &[OsString]) -> anyhow::Result<()> {
    let mut studio = workspace::studio("dev")?;
    let status = studio.args(args).stdout(Stdio::null()).status().context("cannot run aarc-studio")?;
    if !status.success() {
        return Err(Fault::Data("the clips could not be made; the message is above".into()).into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_positive_numbers_are_durations() {
        assert_eq!(seconds("0.5"), Ok(0.5));
        for text in ["0", "-1", "nan", "inf", "1e30", "x"] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }
}
