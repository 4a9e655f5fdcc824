//! Types and lints of the programs for other systems than this machine's: Android, Windows and macOS.
//!
//! Debian's Rust checks them; every warning is an error. C is not compiled: build scripts get a compiler that does
//! nothing, as nothing is linked. So neither C nor its headers are checked, and nothing is run.

use std::process::Command;

use xtask::workspace;

use super::debian_rust;
use super::steps::Steps;
use crate::commands::apk::{FEATURES, TARGET};
use crate::setup::Need;

/// What is built for a system.
struct System {
    name: &'static str,
    target: &'static str,
    selection: &'static [&'static str],
}

/// Both programs, as on Linux.
const PROGRAMS: &[&str] = &["--package", "client", "--package", "studio"];

const SYSTEMS: [System; 3] = [
    System {
        name: "Android",
        target: TARGET,
        selection: &["--package", "client", "--lib", FEATURES[0], FEATURES[1], FEATURES[2]],
    },
    System { name: "Windows", target: "x86_64-pc-windows-gnu", selection: PROGRAMS },
    System { name: "macOS", target: "aarch64-apple-darwin", selection: PROGRAMS },
];

/// A program that takes any arguments and does nothing.
const NOTHING: &str = "true";

/// Checks the systems, one after the other.
pub(super) fn check(steps: &mut Steps) {
    for system in &SYSTEMS {
        let name = format!("lints, {}", system.name);
        if Need::DebianRust.is_met() {
            steps.run(&name, &mut system.clippy());
        } else {
            steps.skip(&name, "no compiler for it is installed");
        }
    }
}

impl System {
    fn clippy(&self) -> Command {
        let mut clippy = workspace::builder(debian_rust::program("cargo-clippy"));
        clippy.args(["clippy", "--quiet"]).args(self.selection);
        debian_rust::configure(&mut clippy, self.target, "std,panic_abort", &debian_rust::folder());
        let target = self.target.replace('-', "_");
        for tool in ["CC", "CXX", "AR", "RANLIB"] {
            clippy.env(format!("{tool}_{target}"), NOTHING);
        }
        // The standard library is compiled; this program makes its import libraries of Windows.
        let dlltool = debian_rust::program("x86_64-w64-mingw32-dlltool");
        clippy.env("CARGO_ENCODED_RUSTFLAGS", format!("-Cdlltool={}", dlltool.display()));
        // Nothing runs.
        clippy.env("CARGO_PROFILE_DEV_OPT_LEVEL", "0").env("CARGO_PROFILE_DEV_DEBUG", "false");
        clippy.args(["--", "--deny", "warnings"]);
        clippy
    }
}
