//! `cargo xtask`: the contributors' commands, and those of the host tool, which the crate `studio` holds.

mod commands;
mod setup;

use std::process::ExitCode;
use std::sync::LazyLock;

use clap::{Parser, Subcommand};
use studio::cli;

/// Makes, inspects and renders clips of 4D Gaussians.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version, long_version = cli::VERSION.as_str())]
#[command(after_long_help = AFTER_HELP.as_str())]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

static AFTER_HELP: LazyLock<String> = LazyLock::new(|| cli::after_help("cargo xtask"));

#[derive(Subcommand)]
enum Command {
    Demo(commands::demo::Args),
    #[command(flatten)]
    Studio(cli::Command),
    Bench(commands::bench::Args),
    Test(commands::test::Args),
    Apk(commands::apk::Args),
    Ci(commands::ci::Args),
}

fn main() -> ExitCode {
    program::exit_on_closed_pipe();
    cli::exit_code(match Cli::parse().command {
        // Measuring links the renderer: a build of its own, optimised.
        Command::Studio(cli::Command::Report(_)) => return commands::report::run(),
        Command::Studio(command) => command.run(),
        Command::Demo(args) => commands::demo::run(&args),
        Command::Bench(args) => commands::bench::run(&args),
        Command::Test(args) => commands::test::run(&args),
        Command::Apk(args) => commands::apk::run(&args),
        Command::Ci(args) => commands::ci::run(&args),
    })
}
