//! A compiler for Android, to check with: Debian's Rust of a recent version, with the source of its
//! library, and a C compiler and linker.
//!
//! Rust's own compiler checks for Android only where its library for Android can be installed, which
//! rustup does; Debian's brings what it takes to build that library. Nothing made with it is for use:
//! there are no headers and no libraries of Android, and those of GNU/Linux on ARM stand in.

use xtask::workspace;

use super::unpacked::{Release, Unpacked};

/// What compiles, checks and links. Debian keeps `rustc-web` as new as browsers need it.
const PACKAGES: &[&str] =
    &["rustc-web", "rust-web-src", "rust-web-clippy", "clang", "lld", "libc6-dev-arm64-cross"];

/// The compiler in its folder.
pub(super) fn compiler() -> Unpacked {
    Unpacked {
        folder: workspace::android_compiler_folder(),
        release: Release::Machine,
        packages: PACKAGES,
        keep: &["usr/bin", "usr/lib", "usr/src/*/library", "usr/aarch64-linux-gnu"],
        size_mb: (266, 1000),
    }
}
