//! `cargo xtask ci`: the checks that only contributors need.
//!
//! Every step runs, even after a failure, so that one run shows all problems. Steps of the
//! workspace run beside those of the workspaces with target folders of their own: while one links or
//! tests on one core, the other compiles. The rules of the sources (which crate may name what, where
//! `unsafe` is allowed) are tests and run with `cargo xtask test`. Checks that this machine cannot run
//! are listed at the end.

mod android;
mod steps;

use std::ffi::OsString;
use std::process::{Command, Stdio};
use std::thread;

use anyhow::bail;
use xtask::workspace;

use crate::setup::{self, Need};
use steps::Steps;

/// Run the checks for contributors: formatting, lints on every feature set, documentation, the tests
/// that need an OpenXR runtime, those of networks (on the ONNX Runtime at ORT_DYLIB_PATH), fuzzing,
/// dependencies, lints for Android and what else can be checked for it without a headset.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Link the player for Android, too, against stand-ins for its libraries. Takes many minutes the
    /// first time.
    #[arg(long)]
    link: bool,
}

/// Sets of packages and features that users build: a build of the whole workspace can hide a dependency or
/// a feature that one of them lacks.
const FEATURE_SETS: [(&str, &[&str]); 9] = [
    ("whole workspace", &["--workspace", "--all-targets", "--features", workspace::FEATURES]),
    ("the player", &["--package", "client"]),
    (
        "the player in a window alone",
        &["--package", "client", "--no-default-features", "--features", "window"],
    ),
    ("the player in a headset alone", &["--package", "client", "--no-default-features", "--features", "xr"]),
    ("the player in neither", &["--package", "client", "--no-default-features"]),
    ("decoding alone", &["--package", "codec"]),
    ("encoding", &["--package", "codec", "--features", "encode"]),
    ("the host tool", &["--package", "studio"]),
    ("camera files", &["--package", "codec", "--features", "serde"]),
];

/// Packages of the workspace codec/fuzz: name, folder, the program that writes the seeds, the fuzz
/// targets.
const FUZZERS: [(&str, &str, &str, &[&str]); 2] = [
    ("codec-fuzz", "codec/fuzz", "seeds", &["decode", "roundtrip"]),
    ("aarc-fuzz", "tests/fuzz", "tool-seeds", &["import", "scene", "capture", "net"]),
];

/// Seconds per target, on one core; a fixed seed, so that runs are comparable; limits of input bytes,
/// seconds per input and MB of memory. The workspace limits the address space.
const FUZZ_LIMITS: [&str; 5] =
    ["-max_total_time=20", "-seed=1", "-max_len=8192", "-timeout=5", "-rss_limit_mb=512"];

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    install_components();
    setup::satisfy(&[
        (Need::CppCompiler, "nothing can be fuzzed and these checks fail"),
        (Need::Headset, "tests of the headset's path are ignored"),
        (Need::AndroidCompiler, "nothing is checked for Android"),
        (Need::ApkTools, "only the packer's own checks look at an APK"),
    ]);
    // A lane each, as Cargo locks a target folder.
    let (mut steps, others) = thread::scope(|scope| {
        let others = scope.spawn(|| {
            let mut steps = Steps { is_captured: true, ..Steps::default() };
            packer(&mut steps);
            android::check(&mut steps, args.link);
            fuzz(&mut steps);
            steps
        });
        let mut steps = Steps::default();
        check_workspace(&mut steps);
        (steps, others.join().expect("no panic"))
    });
    steps.failed.extend(others.failed);
    steps.skipped.extend(others.skipped);
    for skipped in &steps.skipped {
        eprintln!("ci: not checked here: {skipped}");
    }
    if !steps.failed.is_empty() {
        bail!("failed: {}", steps.failed.join("; "));
    }
    Ok(())
}

/// Checks formatting, lints, documentation and dependencies of the workspace, and runs the tests that need an
/// OpenXR runtime.
fn check_workspace(steps: &mut Steps) {
    steps.run("formatting", workspace::cargo().args(["fmt", "--all", "--check"]));
    for (name, selection) in FEATURE_SETS {
        let mut clippy = workspace::cargo();
        clippy.args(["clippy", "--quiet", "--locked"]).args(selection).args(["--", "--deny", "warnings"]);
        steps.run(&format!("lints, {name}"), &mut clippy);
    }
    let features = ["--locked", "--workspace", "--features", workspace::FEATURES];
    steps.run(
        "documentation",
        workspace::cargo()
            .args(["doc", "--quiet", "--no-deps", "--document-private-items"])
            .args(features)
            .env("RUSTDOCFLAGS", "--deny warnings"),
    );
    steps.run("tests in a headset", workspace::cargo().arg("test").args(features).args(["--test", "xr"]));
    deny(steps);
    oldest_rust(steps);
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

/// Checks codec/fuzz, a workspace of its own, and runs its targets from their seeds, earlier corpora and
/// the committed regressions. An input that breaks a target is written to target/fuzz; libFuzzer prints
/// its path.
fn fuzz(steps: &mut Steps) {
    let folder = workspace::root().join("codec/fuzz");
    let out = workspace::target_folder().join("fuzz");
    let cargo = |args: &[&str]| {
        let mut cargo = workspace::cargo();
        // These would override the flags that fuzzing needs.
        cargo.current_dir(&folder).args(args).env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
        cargo
    };
    steps.run("formatting, fuzzing", &mut cargo(&["fmt", "--all", "--check"]));
    let lints = ["clippy", "--quiet", "--locked", "--release", "--workspace", "--all-targets"];
    steps.run("lints, fuzzing", cargo(&lints).args(["--", "--deny", "warnings"]));
    for (package, folder, seeds, targets) in FUZZERS {
        let run = |program| {
            let mut cargo = cargo(&["run", "--quiet", "--locked", "--release", "--package", package]);
            cargo.args(["--bin", program, "--"]);
            cargo
        };
        steps.run(&format!("seeds of {package}"), run(seeds).arg(out.join("corpus")));
        for target in targets {
            let mut artifacts = OsString::from("-artifact_prefix=");
            artifacts.push(out.join(format!("{target}-")));
            let regressions = workspace::root().join(folder).join("regressions").join(target);
            steps.run(
                &format!("fuzzing, {target}"),
                run(target)
                    .arg(out.join("corpus").join(target))
                    .args(regressions.is_dir().then_some(regressions))
                    .args(FUZZ_LIMITS)
                    .args(["-print_final_stats=1", "-verbosity=0"])
                    .arg(artifacts),
            );
        }
    }
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
    let mut check = Command::new("rustup");
    check.current_dir(workspace::root()).args(["run", oldest, "cargo", "check", "--locked", "--workspace"]);
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
