//! The host tool: makes, inspects and renders packages, and runs the project's own checks.

mod commands;
mod setup;

use std::process::ExitCode;
use std::sync::LazyLock;

use clap::{Parser, Subcommand};
use xtask::fault::Fault;

/// What `--version` says: of the program, and of the files that it makes and reads.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let (major, minor) = (codec::VERSION_MAJOR, codec::VERSION_MINOR);
    let field = xtask::import::FIELD_FILE_VERSION;
    format!(
        "{}\nwrites packages (.aarc) of version {major}.{minor}, reads {major}.x\nwrites and reads field \
         files (.ply) of version {field}",
        env!("CARGO_PKG_VERSION")
    )
});

/// What the long help ends with, besides the commands.
const AFTER_HELP: &str = "\
Exit codes:
  0  done
  1  a check failed, or a defect of the program
  2  the command line asks for something impossible, or an output cannot be written
  3  an input is missing, unreadable or not what it should be
  5  there is no graphics device, or a program that is needed is not installed

  An error is one line on standard error: what is wrong, where, and what to do. No output is left
  half-written. Where Ctrl-C ends a command, shells report 130, and what was at the output's path
  stays.

Examples:
  cargo xtask demo
  cargo xtask package scene/ -o clip.aarc --budget 40000
  cargo xtask fit studio/ -o field.ply
  cargo xtask inspect clip.aarc --json
  cargo xtask render clip.aarc --time 0.5 --size 640x480 --out reference.png

The README has more, and what all of it is for.";

/// Makes, inspects and renders clips of 4D Gaussians.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version, long_version = VERSION.as_str())]
#[command(after_long_help = AFTER_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(commands::demo::Args),
    Package(commands::package::Args),
    Fit(commands::fit::Args),
    Depths(commands::depths::Args),
    Inspect(commands::inspect::Args),
    Render(commands::render::Args),
    Eval(commands::eval::Args),
    Report(commands::report::Args),
    Export(commands::export::Args),
    Synth(commands::synth::Args),
    Bench(commands::bench::Args),
    Serve(commands::serve::Args),
    Test(commands::test::Args),
    Apk(commands::apk::Args),
    Ci(commands::ci::Args),
}

fn main() -> ExitCode {
    // Whoever reads what is printed may stop, as `head` does: that ends a command, and is no defect.
    #[cfg(unix)]
    sigpipe::reset();
    let result = match Cli::parse().command {
        Command::Demo(args) => commands::demo::run(&args),
        Command::Package(args) => commands::package::run(&args),
        Command::Fit(args) => commands::fit::run(&args),
        Command::Depths(args) => commands::depths::run(&args),
        Command::Inspect(args) => commands::inspect::run(&args),
        Command::Render(args) => commands::render::run(&args),
        Command::Eval(args) => commands::eval::run(&args),
        Command::Report(args) => commands::report::run(&args),
        Command::Export(args) => commands::export::run(&args),
        Command::Synth(args) => commands::synth::run(&args),
        Command::Bench(args) => commands::bench::run(&args),
        Command::Serve(args) => commands::serve::run(&args),
        Command::Test(args) => commands::test::run(&args),
        Command::Apk(args) => commands::apk::run(&args),
        Command::Ci(args) => commands::ci::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(error.downcast_ref::<Fault>().map_or(1, Fault::exit_code))
        }
    }
}
