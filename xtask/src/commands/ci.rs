//! `cargo xtask ci`: the checks that only contributors need.
//!
//! Every step runs, also after one has failed, so that one run shows every failure. Steps of the
//! workspace run beside those of the workspaces with target folders of their own: while one links or
//! tests on one core, the other compiles. The rules of the sources (which crate may name what, where
//! `unsafe` is allowed) are tests and run with `cargo xtask test`. Checks that this machine cannot run
//! are listed at the end.

mod android;

use std::ffi::OsString;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Instant;

use anyhow::bail;
use xtask::workspace;

use crate::setup::{self, Need};

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

/// The packages of the workspace in codec/fuzz, with the folder of each, the program that writes what
/// to start from, and those that look for inputs that break something.
const FUZZERS: [(&str, &str, &str, &[&str]); 2] = [
    ("codec-fuzz", "codec/fuzz", "seeds", &["decode", "roundtrip"]),
    ("aarc-fuzz", "tests/fuzz", "tool-seeds", &["import", "scene", "capture", "net"]),
];

/// How long each looks, on one core, from what random numbers, so that luck does not fail a change,
/// and what it may use: bytes of an input, seconds for one, MB of memory. The workspace limits the
/// address space.
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

/// The outcomes of the steps so far.
#[derive(Default)]
struct Steps {
    /// Print the output of a step when it has ended, not between that of other steps.
    is_captured: bool,
    failed: Vec<String>,
    skipped: Vec<String>,
}

impl Steps {
    /// Runs a step and returns whether it passed.
    fn run(&mut self, name: &str, command: &mut Command) -> bool {
        let start = Instant::now();
        eprintln!("ci: {name}");
        command.stdin(Stdio::null());
        let status = if self.is_captured {
            command.output().map(|output| {
                eprint!("{}", String::from_utf8_lossy(&[output.stdout, output.stderr].concat()));
                output.status
            })
        } else {
            command.status()
        };
        let passed = status.is_ok_and(|status| status.success());
        let seconds = start.elapsed().as_secs_f64();
        eprintln!("ci: {name}: {} after {seconds:.1} s", if passed { "ok" } else { "FAILED" });
        if !passed {
            self.failed.push(name.to_owned());
        }
        passed
    }

    /// Notes a step that cannot be run, and why.
    fn skip(&mut self, name: &str, reason: &str) {
        self.skipped.push(format!("{name}: {reason}"));
    }
}

/// Checks the packer of APKs, a workspace of its own: its tests pack stub libraries and read the
/// APK back.
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

/// Checks the sources of codec/fuzz, a workspace of its own, and runs its targets from the seeds
/// that they write, what earlier runs found and the committed regressions. An input that breaks one
/// is left in target/fuzz, under the path that is printed.
fn fuzz(steps: &mut Steps) {
    let folder = workspace::root().join("codec/fuzz");
    let out = workspace::target_folder().join("fuzz");
    let cargo = |args: &[&str]| {
        let mut cargo = workspace::cargo();
        // These flags would take the place of those that fuzzing needs.
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

/// Checks licences, sources and known vulnerabilities of dependencies where cargo-deny is installed,
/// which takes longer to build than everything here. Licences and sources are also tested without.
fn deny(steps: &mut Steps) {
    let is_there = workspace::cargo().args(["deny", "--version"]).output();
    if !is_there.is_ok_and(|output| output.status.success()) {
        steps.skip("known vulnerabilities of dependencies", "cargo-deny is not installed");
        return;
    }
    steps.run("dependencies", workspace::cargo().args(["deny", "check", "bans", "licenses", "sources"]));
    // Their list comes over the network: without one, an older list would pass what is known by now.
    let fetched =
        workspace::cargo().args(["deny", "fetch", "db"]).status().is_ok_and(|status| status.success());
    if fetched {
        steps.run(
            "known vulnerabilities of dependencies",
            workspace::cargo().args(["deny", "check", "advisories"]),
        );
    } else {
        steps.skip("known vulnerabilities of dependencies", "their list cannot be fetched");
    }
}

/// Compiles the workspace, without its tests and optional features, with the oldest Rust that the
/// packages say they need, where this one is newer. The other workspaces are not: their
/// `rust-version` is only held to the same.
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
        steps.skip(&name, "rustup does not have it");
        return;
    }
    let mut check = Command::new("rustup");
    check.current_dir(workspace::root()).args(["run", oldest, "cargo", "check", "--locked", "--workspace"]);
    steps.run(&name, &mut check);
}

/// Installs the toolchain's formatter and linter where a minimal toolchain lacks them.
fn install_components() {
    for (subcommand, component) in [("fmt", "rustfmt"), ("clippy", "clippy")] {
        let is_there = workspace::cargo()
            .args([subcommand, "--version"])
            .output()
            .is_ok_and(|output| output.status.success());
        if !is_there {
            eprintln!("ci: rustup component add {component}");
            // Where this fails, the step that needs the component fails, and says so.
            let _ =
                Command::new("rustup").args(["component", "add", component]).stdin(Stdio::null()).status();
        }
    }
}
