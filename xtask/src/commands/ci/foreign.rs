//! Other processors, emulated: packages are decoded to the same numbers there and encoded to the same bytes.
//!
//! Debian's Rust builds the codec's tests, its C cross compilers build zstd and link, QEMU runs them. The
//! processors differ from x86-64 in instructions, vector units, the size of `usize`, and byte order.

use std::env::consts::ARCH;
use std::process::Command;

use xtask::workspace;

use super::debian_rust;
use super::steps::Steps;
use crate::setup::Need;

/// A processor.
struct Processor {
    name: &'static str,
    /// Rust's target.
    target: &'static str,
    /// Start of the names of its C compiler and linker.
    tools: &'static str,
    emulator: &'static str,
}

const PROCESSORS: [Processor; 3] = [
    Processor {
        name: "64-bit ARM",
        target: "aarch64-unknown-linux-gnu",
        tools: "aarch64-linux-gnu",
        emulator: "qemu-aarch64",
    },
    Processor {
        name: "32-bit ARM",
        target: "armv7-unknown-linux-gnueabihf",
        tools: "arm-linux-gnueabihf",
        emulator: "qemu-arm",
    },
    // Not s390x: QEMU 7.2 takes one factor for an `f64` where two `f32` make one (MDEBR).
    Processor {
        name: "64-bit PowerPC, with the other byte order",
        target: "powerpc64-unknown-linux-gnu",
        tools: "powerpc64-linux-gnu",
        emulator: "qemu-ppc64",
    },
];

/// Runs the codec's tests on each processor.
pub(super) fn check(steps: &mut Steps) {
    for processor in &PROCESSORS {
        let name = format!("the codec on {}", processor.name);
        if Need::Foreign.is_met() && Need::DebianRust.is_met() {
            steps.run(&name, &mut processor.test());
        } else {
            steps.skip(&name, "its compilers or its emulator are not there");
        }
    }
}

impl Processor {
    /// A command that runs the tests that compare with frozen packages, and the tests of whole packages.
    fn test(&self) -> Command {
        let mut cargo = workspace::cargo();
        cargo.args(["test", "--quiet", "--package", "codec", "--features", "encode"]);
        cargo.args(["--lib", "--test", "golden", "--test", "round_trip"]);
        debian_rust::configure(
            &mut cargo,
            self.target,
            "std,test,panic_unwind",
            &workspace::target_folder().join("foreign-check"),
        );
        let folder = workspace::foreign_folder();
        let tool = |name: &str| folder.join("usr/bin").join(format!("{}-{name}", self.tools));
        let variable = |name: &str| name.replace('-', "_");
        let upper = variable(self.target).to_uppercase();
        let emulator = folder.join("usr/bin").join(self.emulator);
        let own_libraries = folder.join(format!("usr/lib/{ARCH}-linux-gnu"));
        let libraries = [debian_rust::libraries(), own_libraries].map(|path| path.display().to_string());
        cargo
            // As a list, which Cargo does not split at blanks.
            .args(["--config", &format!("target.{}.runner = [{emulator:?}]", self.target)])
            .env("LD_LIBRARY_PATH", libraries.join(":"))
            .env(format!("CC_{}", variable(self.target)), tool("gcc"))
            .env(format!("AR_{}", variable(self.target)), tool("ar"))
            .env(format!("CARGO_TARGET_{upper}_LINKER"), tool("gcc"))
            // The emulated program then loads no library.
            .env(format!("CARGO_TARGET_{upper}_RUSTFLAGS"), "-Ctarget-feature=+crt-static");
        cargo
    }
}
