//! `cargo xtask`: the contributors' commands. All others are those of the host tool, `aarc-studio`, which is
//! built if need be and takes this program's place.

mod commands;
mod setup;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use program::Fault;
use xtask::workspace;

/// The end of the long help: the host tool's commands, and examples.
const AFTER_HELP: &str = "\
Commands of the host tool, aarc-studio; `cargo xtask COMMAND --help` has their options:
  package  Make a package of a fitted field, or of a capture
  fit      Fit a field to a capture
  depths   Make depth maps with a network
  inspect  List the contents of a package
  render   Render images with the CPU reference (f64)
  eval     Compare a field, a package or pictures with photographs
  report   Write a page: error against run time, and only what a scene needs
  export   Write other formats
  synth    Make procedural data
  serve    Serve a folder over HTTP

Examples:
  cargo xtask demo
  cargo xtask package scene/ -o clip.aarc --budget 40000
  cargo xtask fit studio/ -o field.ply

xtask/README.md says more.";

/// Works on the project, and makes, inspects and renders clips of 4D Gaussians.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version, after_help = AFTER_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(commands::demo::Args),
    Bench(commands::bench::Args),
    Test(commands::test::Args),
    Apk(commands::apk::Args),
    Notices(commands::notices::Args),
    Picture(commands::picture::Args),
    Ci(commands::ci::Args),
    #[command(external_subcommand)]
    Studio(Vec<OsString>),
}

fn main() -> ExitCode {
    program::exit_on_closed_pipe();
    let done = |()| ExitCode::SUCCESS;
    let result = match Cli::parse().command {
        Command::Demo(args) => commands::demo::run(&args).map(done),
        Command::Bench(args) => commands::bench::run(&args).map(done),
        Command::Test(args) => commands::test::run(&args).map(done),
        Command::Apk(args) => commands::apk::run(&args).map(done),
        Command::Notices(args) => commands::notices::run(&args).map(done),
        Command::Picture(args) => commands::picture::run(&args).map(done),
        Command::Ci(args) => commands::ci::run(&args).map(done),
        Command::Studio(args) => hand_over(&args),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(error.downcast_ref::<Fault>().map_or(1, Fault::exit_code))
        }
    }
}

/// Runs the host tool with `args` in place of this program.
///
/// # Errors
/// [`Fault::Device`] where it cannot be built or run.
fn hand_over(args: &[OsString]) -> anyhow::Result<ExitCode> {
    // A report measures the optimised player that people use.
    let is_optimised = !cfg!(debug_assertions) || args[0] == "report";
    let profile = if is_optimised { "release" } else { "dev" };
    let mut studio = workspace::studio(profile)?;
    studio.args(args);
    #[cfg(unix)]
    let status: std::io::Result<std::process::ExitStatus> =
        Err(std::os::unix::process::CommandExt::exec(&mut studio));
    #[cfg(not(unix))]
    let status = studio.status();
    let status = status.map_err(|error| Fault::Device(format!("cannot run aarc-studio: {error}")))?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}
