//! The command line of the player.

use std::process::ExitCode;

use clap::CommandFactory;
use client::args::Args;
use client::headless;
use log::LevelFilter;
use program::{Fault, generate};

fn main() -> ExitCode {
    let quiet = env_logger::Env::default().default_filter_or(client::gpu::LOG_FILTER);
    // Below that level the HTTP library logs URLs with their secrets. Where there is no file dialog, the window says so.
    env_logger::Builder::from_env(quiet)
        .filter_module("ureq", LevelFilter::Info)
        .filter_module("rfd", LevelFilter::Off)
        .init();
    let args: Args = match program::parse(Args::command()) {
        Ok(args) => args,
        Err(code) => return code,
    };
    program::run(|| run(&args), Fault::exit_code)
}

fn run(args: &Args) -> Result<(), Fault> {
    args.check()?;
    if let Some(document) = args.generate.generate {
        generate::print(document, Args::command())
    } else if args.headless {
        headless::run(args)
    } else if args.xr {
        headset(args)
    } else {
        window(args)
    }
}

#[cfg(feature = "window")]
fn window(args: &Args) -> Result<(), Fault> {
    client::window::run(args)
}

#[cfg(not(feature = "window"))]
fn window(_args: &Args) -> Result<(), Fault> {
    Err(Fault::Usage("built without a window: give --headless --out PATH, or --xr".into()))
}

#[cfg(feature = "xr")]
fn headset(args: &Args) -> Result<(), Fault> {
    client::xr::run(args)
}

#[cfg(not(feature = "xr"))]
fn headset(_args: &Args) -> Result<(), Fault> {
    Err(Fault::Usage("built without headsets: build with the feature xr".into()))
}
