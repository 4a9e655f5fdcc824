//! `cargo xtask`: the contributors' commands, and the commands of the host tool, `aarc-studio`, which is built if
//! need be and takes this program's place.

mod commands;
mod setup;

use std::env;
use std::ffi::OsString;
use std::process::{self, ExitCode};

use clap::{CommandFactory, Parser, Subcommand};
use program::Fault;
use xtask::workspace;

/// The host tool's commands, and what each does.
const STUDIO: [(&str, &str); 13] = [
    ("package", "Make a package from a fitted field, or from a capture"),
    ("join", "Join fields and clips, one after another, into the folder of a take"),
    ("trim", "Cut a part out of a take, without coding it anew"),
    ("poster", "Show or change the time and view that stand for a clip"),
    ("ingest", "Make a capture of a rig's videos and calibration"),
    ("fit", "Fit a field to the photographs of a capture"),
    ("depths", "Estimate depth maps with a network"),
    ("inspect", "Show the contents of a package, and validate it"),
    ("render", "Render images with the CPU reference (f64)"),
    ("eval", "Compare a field, a package or pictures with photographs"),
    ("report", "Write a page: error against run time, and only what a scene needs"),
    ("export", "Write a clip or field in another format"),
    ("synth", "Make procedural scenes and captures"),
];

/// The end of the help.
const AFTER_HELP: &str = "\
The commands from package on are those of the host tool, aarc-studio, which is built first if need be;
`cargo xtask COMMAND --help` has their options, `cargo xtask --version` prints the versions of the formats.

Examples:
  cargo xtask demo
  cargo xtask package scene/ -o clip.aarc --budget 40000
  cargo xtask ingest rig/ -o studio/
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
    Dist(commands::dist::Args),
    Headset(commands::headset::Args),
    Notices(commands::notices::Args),
    Picture(commands::picture::Args),
    Ci(commands::ci::Args),
}

fn main() -> ExitCode {
    program::exit_on_closed_pipe();
    let args: Vec<OsString> = env::args_os().skip(1).collect();
    if let Some(args) = for_studio(&args) {
        return program::run(|| hand_over(&args), |fault| fault.exit_code());
    }
    // The host tool's commands are listed and suggested as well.
    let studio = STUDIO.map(|(name, about)| clap::Command::new(name).about(about));
    let cli: Cli = match program::parse(Cli::command().subcommands(studio)) {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    program::run(|| cli.command.run(), |error| program::exit_code(error.as_ref()))
}

impl Command {
    fn run(&self) -> anyhow::Result<()> {
        match self {
            Command::Demo(args) => commands::demo::run(args),
            Command::Bench(args) => commands::bench::run(args),
            Command::Test(args) => commands::test::run(args),
            Command::Apk(args) => commands::apk::run(args),
            Command::Dist(args) => commands::dist::run(args),
            Command::Headset(args) => commands::headset::run(args),
            Command::Notices(args) => commands::notices::run(args),
            Command::Picture(args) => commands::picture::run(args),
            Command::Ci(args) => commands::ci::run(args),
        }
    }
}

/// The host tool's arguments, if these are for it: one of its commands, help about one, or `--version`.
fn for_studio(args: &[OsString]) -> Option<Vec<OsString>> {
    let is_command = |arg: &OsString| STUDIO.iter().any(|(name, _)| arg == name);
    match args {
        [first, ..] if is_command(first) || first == "--version" => Some(args.to_vec()),
        [help, name, ..] if help == "help" && is_command(name) => Some(vec![name.clone(), "--help".into()]),
        _ => None,
    }
}

/// Runs the host tool with `args` in place of this program.
///
/// # Errors
/// [`Fault::Device`] where it cannot be built or run.
fn hand_over(args: &[OsString]) -> Result<(), Fault> {
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
    process::exit(status.code().unwrap_or(1))
}
