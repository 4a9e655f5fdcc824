//! Fuzzing: codec/fuzz, a workspace of its own with the fuzzers of all inputs.

use std::ffi::OsString;
use std::process::Command;
use std::thread;

use xtask::workspace;

use super::steps::Steps;

/// A package of fuzz targets.
struct Fuzzer {
    package: &'static str,
    folder: &'static str,
    /// The program that writes the seeds.
    seeds: &'static str,
    targets: &'static [&'static str],
}

const FUZZERS: [Fuzzer; 2] = [
    Fuzzer {
        package: "codec-fuzz",
        folder: "codec/fuzz",
        seeds: "seeds",
        targets: &["decode", "roundtrip", "sound"],
    },
    Fuzzer {
        package: "aarc-fuzz",
        folder: "tests/fuzz",
        seeds: "tool-seeds",
        targets: &["import", "scene", "capture", "net"],
    },
];

/// Seconds per target.
const SECONDS: u32 = 300;

/// A fixed seed, so that runs are comparable; limits of input bytes, seconds per input and MB of memory. The
/// workspace limits the address space.
const LIMITS: [&str; 4] = ["-seed=1", "-max_len=8192", "-timeout=5", "-rss_limit_mb=512"];

/// Targets that run at the same time, each on one core.
const AT_ONCE: usize = 2;

/// Checks the workspace, and runs its targets from their seeds, earlier corpora and the committed regressions. An
/// input that breaks a target is written to target/fuzz; libFuzzer prints its path.
pub(super) fn check(steps: &mut Steps) {
    steps.run("formatting, fuzzing", cargo().args(["fmt", "--all", "--check"]));
    let lints = ["clippy", "--quiet", "--locked", "--release", "--workspace", "--all-targets"];
    steps.run("lints, fuzzing", cargo().args(lints).args(["--", "--deny", "warnings"]));
    let build = ["build", "--quiet", "--locked", "--release", "--workspace"];
    if !steps.run("building the fuzzers", cargo().args(build)) {
        return;
    }
    for fuzzer in &FUZZERS {
        let corpus = workspace::target_folder().join("fuzz/corpus");
        steps.run(&format!("seeds of {}", fuzzer.package), fuzzer.program(fuzzer.seeds).arg(corpus));
    }
    let targets: Vec<_> =
        FUZZERS.iter().flat_map(|fuzzer| fuzzer.targets.iter().map(move |target| (fuzzer, target))).collect();
    for some in targets.chunks(AT_ONCE) {
        let run = |&(fuzzer, target): &(&Fuzzer, &&str)| {
            let mut steps = Steps { is_captured: true, ..Steps::default() };
            steps.run(&format!("fuzzing, {target}"), &mut fuzzer.run(target));
            steps
        };
        let done: Vec<Steps> = thread::scope(|scope| {
            let running: Vec<_> = some.iter().map(|target| scope.spawn(move || run(target))).collect();
            running.into_iter().map(|run| run.join().expect("no panic")).collect()
        });
        done.into_iter().for_each(|done| steps.extend(done));
    }
}

fn cargo() -> Command {
    let mut cargo = workspace::cargo();
    cargo.current_dir(workspace::root().join("codec/fuzz"));
    // These would override the flags that fuzzing needs.
    cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    cargo
}

impl Fuzzer {
    /// A command that runs a program of the package, followed by its arguments.
    fn program(&self, name: &str) -> Command {
        let mut cargo = cargo();
        cargo.args([
            "run",
            "--quiet",
            "--locked",
            "--release",
            "--package",
            self.package,
            "--bin",
            name,
            "--",
        ]);
        cargo
    }

    /// A command that runs a target.
    fn run(&self, target: &str) -> Command {
        let out = workspace::target_folder().join("fuzz");
        let mut artifacts = OsString::from("-artifact_prefix=");
        artifacts.push(out.join(format!("{target}-")));
        let regressions = workspace::root().join(self.folder).join("regressions").join(target);
        let mut run = self.program(target);
        run.arg(out.join("corpus").join(target))
            .args(regressions.is_dir().then_some(regressions))
            .args(LIMITS)
            .arg(format!("-max_total_time={SECONDS}"))
            .args(["-print_final_stats=1", "-verbosity=0"])
            .arg(artifacts);
        run
    }
}
