//! `cargo xtask ci`: the checks that only contributors need.
//!
//! A plain run is short: it comes before every landing. `--full` adds what takes long and seldom fails. Every step runs,
//! even after a failure, so that one run shows all problems. In a full run, steps of the
//! workspace run beside the steps of the workspaces with target folders of their own: while one links or
//! tests on one core, the other compiles. The rules of the sources (which crate may name what, where
//! `unsafe` is allowed) are tests and run with `cargo xtask test`. Checks that this machine cannot run
//! are listed at the end.

mod android;
mod debian_rust;
mod foreign;
mod fuzz;
mod steps;
mod systems;

use std::process::{Command, Stdio};
use std::thread;

use anyhow::bail;
use xtask::workspace;

use crate::setup::{self, Need, SetupArgs};
use steps::Steps;

/// Run the checks for contributors: formatting, lints and documentation of the whole workspace, the tests that need an
/// OpenXR runtime or ONNX Runtime, dependencies
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Check everything, which takes an hour or two: also the sets of features that users build, the oldest Rust,
    /// Android, Windows and macOS (types and lints), what can be checked for Android without a headset, a second
    /// Vulkan driver, emulated processors, fuzzing for five minutes each target, and playing for ten
    #[arg(long)]
    full: bool,

    #[command(flatten)]
    setup: SetupArgs,
}

/// Packages and features of the whole workspace.
const WORKSPACE: &[&str] = &["--workspace", "--all-targets", "--features", workspace::FEATURES];

/// Sets of packages and features that users build: a build of the whole workspace can hide a dependency or
/// a feature that one of them lacks.
const FEATURE_SETS: [(&str, &[&str]); 9] = [
    ("the player", &["--package", "client"]),
    (
        "the player in a window alone",
        &["--package", "client", "--no-default-features", "--features", "window"],
    ),
    (
        "the player without sound",
        &["--package", "client", "--no-default-features", "--features", "net,window,xr"],
    ),
    ("the player in a headset alone", &["--package", "client", "--no-default-features", "--features", "xr"]),
    ("the player in neither", &["--package", "client", "--no-default-features"]),
    ("decoding alone", &["--package", "codec"]),
    ("encoding", &["--package", "codec", "--features", "encode"]),
    ("the host tool", &["--package", "studio"]),
    ("camera files", &["--package", "codec", "--features", "serde"]),
];

/// Minutes of playing in a full run.
const SOAK_MINUTES: &str = "10";

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let mut needs = vec![
        (Need::SoundHeaders, "the player cannot be built and these checks fail"),
        (Need::Vulkan, "nothing is drawn to compare the headset's pictures with, and their tests fail"),
        (Need::Headset, "tests of the headset's path are ignored"),
        (Need::OnnxRuntime, "tests of networks are ignored"),
    ];
    if args.full {
        needs.extend([
            (Need::CppCompiler, "nothing can be fuzzed and these checks fail"),
            (Need::DebianRust, "nothing is checked for Android, Windows and macOS"),
            (Need::ApkTools, "only the packer's own checks look at an APK"),
            (Need::SecondDriver, "only the machine's own driver draws"),
            (Need::Foreign, "other processors are not emulated"),
        ]);
    }
    if !setup::satisfy(&args.setup, &needs) {
        return Ok(());
    }
    install_components();
    let steps = if args.full { everything() } else { workspace_steps() };
    for skipped in &steps.skipped {
        eprintln!("ci: not checked here: {skipped}");
    }
    if !steps.failed.is_empty() {
        bail!("failed: {}", steps.failed.join("; "));
    }
    Ok(())
}

/// Checks formatting, lints, documentation and dependencies of the workspace, and runs the tests that need an
/// OpenXR runtime or ONNX Runtime.
fn workspace_steps() -> Steps {
    let mut steps = Steps::default();
    steps.run("formatting", workspace::cargo().args(["fmt", "--all", "--check"]));
    lint(&mut steps, "whole workspace", WORKSPACE);
    steps.run(
        "documentation",
        workspace::cargo()
            .args(["doc", "--quiet", "--locked", "--workspace", "--features", workspace::FEATURES])
            .args(["--no-deps", "--document-private-items"])
            .env("RUSTDOCFLAGS", "--deny warnings"),
    );
    steps.run("tests in a headset", &mut tests(&["xr"]));
    match workspace::onnx_library() {
        Some(library) => {
            steps.run("tests of networks", tests(&["depths"]).env("ORT_DYLIB_PATH", library));
        }
        None => steps.skip("networks", "ONNX Runtime is not there"),
    }
    deny(&mut steps);
    steps
}

/// All checks, in two lanes, as Cargo locks a target folder.
fn everything() -> Steps {
    thread::scope(|scope| {
        let others = scope.spawn(|| {
            let mut steps = Steps { is_captured: true, ..Steps::default() };
            fuzz::check(&mut steps);
            packer(&mut steps);
            systems::check(&mut steps);
            android::check(&mut steps);
            foreign::check(&mut steps);
            steps
        });
        let mut steps = workspace_steps();
        for (name, selection) in FEATURE_SETS {
            lint(&mut steps, name, selection);
        }
        oldest_rust(&mut steps);
        check_long(&mut steps);
        steps.extend(others.join().expect("no panic"));
        steps
    })
}

/// Runs the linter on a selection of packages and features; every warning is an error.
fn lint(steps: &mut Steps, name: &str, selection: &[&str]) {
    let mut clippy = workspace::cargo();
    clippy.args(["clippy", "--quiet", "--locked"]).args(selection).args(["--", "--deny", "warnings"]);
    steps.run(&format!("lints, {name}"), &mut clippy);
}

/// Cargo's command that runs test programs of the workspace.
fn tests(programs: &[&str]) -> Command {
    let mut cargo = workspace::cargo();
    cargo.args(["test", "--locked", "--workspace", "--features", workspace::FEATURES]);
    cargo.args(programs.iter().flat_map(|program| ["--test", program]));
    cargo
}

/// The steps of a full run in the workspace: a second driver draws what the tests compare with the
/// reference, and the player plays for long.
fn check_long(steps: &mut Steps) {
    let manifest = workspace::swiftshader_folder().join("usr/lib/chromium/vk_swiftshader_icd.json");
    if Need::SecondDriver.is_met() {
        let mut draw = tests(&["rendering", "fit_gpu"]);
        // The golden images are the first driver's: 8-bit blending rounds as the driver likes.
        draw.args(["--no-fail-fast", "--", "--skip", "the demo scene"]);
        steps.run("drawing with SwiftShader", draw.env("VK_DRIVER_FILES", manifest));
    } else {
        steps.skip("drawing with a second driver", "SwiftShader is not there");
    }
    match workspace::build("soak", "dev") {
        Ok(soak) => {
            steps.run("playing for long", Command::new(soak).arg(SOAK_MINUTES));
        }
        Err(fault) => steps.fail("playing for long", &fault),
    }
}

/// Checks the APK packer, a workspace of its own: its tests pack stub libraries and read the APK back.
fn packer(steps: &mut Steps) {
    let cargo = |args: &[&str]| {
        let mut cargo = workspace::cargo();
        cargo.current_dir(workspace::root().join("xtask/apk")).args(args);
        cargo
    };
    steps.run("formatting, the packer", &mut cargo(&["fmt", "--check"]));
    let lints = ["clippy", "--quiet", "--locked", "--all-targets", "--", "--deny", "warnings"];
    steps.run("lints, the packer", &mut cargo(&lints));
    steps.run("tests of the packer", &mut cargo(&["test", "--quiet", "--locked"]));
}

/// Checks licences, sources and known vulnerabilities of dependencies, if cargo-deny is installed; its
/// build would take longer than everything here. A test checks licences and sources without it.
fn deny(steps: &mut Steps) {
    let is_there = workspace::cargo().args(["deny", "--version"]).output();
    if !is_there.is_ok_and(|output| output.status.success()) {
        steps.skip("known vulnerabilities of dependencies", "cargo-deny is not installed");
        return;
    }
    steps.run("dependencies", workspace::cargo().args(["deny", "check", "bans", "licenses", "sources"]));
    // Without the network, an outdated list would miss newer vulnerabilities.
    let fetched =
        workspace::cargo().args(["deny", "fetch", "db"]).status().is_ok_and(|status| status.success());
    if fetched {
        steps.run(
            "known vulnerabilities of dependencies",
            workspace::cargo().args(["deny", "check", "advisories"]),
        );
    } else {
        steps.skip("known vulnerabilities of dependencies", "the list cannot be downloaded");
    }
}

/// Compiles the workspace, without tests and optional features, with the oldest supported Rust, if the
/// current one is newer. Of the other workspaces only the `rust-version` is checked, by a test.
fn oldest_rust(steps: &mut Steps) {
    let oldest = env!("CARGO_PKG_RUST_VERSION");
    let version = Command::new("rustc").arg("--version").output();
    let version =
        version.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
    if version.starts_with(&format!("rustc {oldest}")) {
        return;
    }
    let name = format!("the workspace with the oldest Rust, {oldest}");
    let has_it = Command::new("rustup").args(["run", oldest, "rustc", "--version"]).output();
    if !has_it.is_ok_and(|output| output.status.success()) {
        steps.skip(&name, "rustup has not installed it");
        return;
    }
    let mut check = workspace::builder("rustup");
    check.args(["run", oldest, "cargo", "check", "--locked", "--workspace"]);
    steps.run(&name, &mut check);
}

/// Installs formatter and linter if the toolchain lacks them.
fn install_components() {
    for (subcommand, component) in [("fmt", "rustfmt"), ("clippy", "clippy")] {
        let is_there = workspace::cargo()
            .args([subcommand, "--version"])
            .output()
            .is_ok_and(|output| output.status.success());
        if !is_there {
            eprintln!("ci: rustup component add {component}");
            // If this fails, the step that needs the component fails and reports it.
            let _ =
                Command::new("rustup").args(["component", "add", component]).stdin(Stdio::null()).status();
        }
    }
}
