//! A compiler to check Android code with: a recent Rust from Debian, with the source of its standard
//! library, and a C compiler and linker.
//!
//! rustup's compiler needs its standard library for Android installed; Debian's can build that library
//! from source. Its output is for checking only: headers and libraries of GNU/Linux on ARM stand in for
//! Android's.

use xtask::workspace;

use super::unpacked::{Release, Unpacked};

/// Compilers, linter and linker. Debian keeps `rustc-web` as new as browsers need it.
const PACKAGES: &[&str] =
    &["rustc-web", "rust-web-src", "rust-web-clippy", "clang", "lld", "libc6-dev-arm64-cross"];

/// The compiler and its folder.
pub(super) fn compiler() -> Unpacked {
    Unpacked {
        folder: workspace::android_compiler_folder(),
        release: Release::Machine,
        packages: PACKAGES,
        keep: &["usr/bin", "usr/lib", "usr/src/*/library", "usr/aarch64-linux-gnu"],
        size_mb: (266, 1000),
    }
}
