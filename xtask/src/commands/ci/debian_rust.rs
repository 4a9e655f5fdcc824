//! Debian's Rust in the folder that the set-up makes: it builds its standard library from source, for any
//! target, where rustup's compiler needs one installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use xtask::workspace;

/// Path of a program of the compilers.
pub(super) fn program(name: &str) -> PathBuf {
    workspace::debian_rust_folder().join("usr/bin").join(name)
}

/// Folder of the shared libraries that the programs load.
pub(super) fn libraries() -> PathBuf {
    workspace::debian_rust_folder().join(format!("usr/lib/{}-linux-gnu", std::env::consts::ARCH))
}

/// Build folder of what is checked for other systems, which share build scripts and macros.
pub(super) fn folder() -> PathBuf {
    workspace::target_folder().join("systems-check")
}

/// Sets arguments and environment so that Cargo builds for `target` with this compiler, and the crates
/// `library` of the standard library, in a build folder of their own: another compiler must not share
/// Cargo's cache.
pub(super) fn configure(cargo: &mut Command, target: &str, library: &str, folder: &Path) {
    cargo
        .args(["--locked", "--target", target, &format!("-Zbuild-std={library}"), "--target-dir"])
        .arg(folder)
        .env("LD_LIBRARY_PATH", libraries())
        .env("RUSTC", program("rustc"))
        // Lets this stable compiler build its standard library.
        .env("RUSTC_BOOTSTRAP", "1")
        .env_remove("RUSTC_WRAPPER")
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS");
}
