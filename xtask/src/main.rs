//! The host tool: makes, inspects and renders packages, and runs the project's own checks.

mod commands;
mod setup;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use xtask::fault::Fault;

/// Makes, inspects and renders clips of 4D Gaussians.
///
/// Exit codes: 0 done, 1 defect or failed check, 2 usage, 3 bad data, 5 no device.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
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
