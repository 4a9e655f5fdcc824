//! The command line of `aarc-studio`; `cargo xtask` hands these commands over.

use std::process::ExitCode;
use std::sync::LazyLock;

use clap::{Parser, Subcommand};
use program::Fault;

use crate::commands;

/// The version of the program, and those of the files that it reads and writes.
pub static VERSION: LazyLock<String> = LazyLock::new(|| {
    let (major, minor) = (codec::VERSION_MAJOR, codec::VERSION_MINOR);
    let field = crate::import::FIELD_FILE_VERSION;
    format!(
        "{}\nwrites packages (.aarc) of version {major}.{minor}, reads {major}.x\nwrites and reads field \
         files (.ply) of version {field}",
        env!("CARGO_PKG_VERSION")
    )
});

/// The end of the long help of `program`: exit codes and examples.
pub fn after_help(program: &str) -> String {
    let demo = if program == "cargo xtask" { "  cargo xtask demo\n" } else { "" };
    format!(
        "\
Exit codes:
  0  done
  1  a check failed, or a defect of the program
  2  the command line asks for something impossible, or an output cannot be written
  3  an input is missing, unreadable or damaged
  5  there is no graphics device, or a required program is not installed

  An error is one line on standard error: what is wrong, where, and what to do. No output is left
  half-written. Shells report 130 where Ctrl-C ends a command; the file at the output's path stays as
  it was.

Examples:
{demo}  {program} package scene/ -o clip.aarc --budget 40000
  {program} fit studio/ -o field.ply
  {program} inspect clip.aarc --json
  {program} render clip.aarc --time 0.5 --size 640x480 --out reference.png

README.md says more."
    )
}

static AFTER_HELP: LazyLock<String> = LazyLock::new(|| after_help("aarc-studio"));

/// Makes, inspects and renders clips of 4D Gaussians.
#[derive(Parser)]
#[command(name = "aarc-studio", bin_name = "aarc-studio", version, long_version = VERSION.as_str())]
#[command(after_long_help = AFTER_HELP.as_str())]
pub struct Cli {
    /// The command to run.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of the host tool.
#[derive(Subcommand)]
#[allow(missing_docs, reason = "clap would show them in place of the commands' own help")]
pub enum Command {
    Package(commands::package::Args),
    Fit(commands::fit::Args),
    Depths(commands::depths::Args),
    Inspect(commands::inspect::Args),
    Render(commands::render::Args),
    Eval(commands::eval::Args),
    Report(commands::report::Args),
    Export(commands::export::Args),
    Synth(commands::synth::Args),
    Serve(commands::serve::Args),
}

impl Command {
    /// Runs the command.
    ///
    /// # Errors
    /// [`Fault`] with an exit code of its own; any other error is a failed check or a defect.
    pub fn run(&self) -> anyhow::Result<()> {
        match self {
            Command::Package(args) => commands::package::run(args),
            Command::Fit(args) => commands::fit::run(args),
            Command::Depths(args) => commands::depths::run(args),
            Command::Inspect(args) => commands::inspect::run(args),
            Command::Render(args) => commands::render::run(args),
            Command::Eval(args) => commands::eval::run(args),
            Command::Report(args) => commands::report::run(args),
            Command::Export(args) => commands::export::run(args),
            Command::Synth(args) => commands::synth::run(args),
            Command::Serve(args) => commands::serve::run(args),
        }
    }
}

/// Prints the error of a command, if any, and returns its exit code.
pub fn exit_code(result: anyhow::Result<()>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    eprintln!("error: {error:#}");
    ExitCode::from(error.downcast_ref::<Fault>().map_or(1, Fault::exit_code))
}
