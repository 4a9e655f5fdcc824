//! An OpenXR runtime for tests: Monado with a simulated headset and a null compositor,
//! the OpenXR loader, Khronos's validation layer and Mesa's software Vulkan driver.
//!
//! Few Linux releases ship a recent one, so every machine uses the packages of one Debian release.

use xtask::workspace;

use super::unpacked::{Release, Unpacked};

/// Packages that the tests start and load.
const PACKAGES: &[&str] = &[
    "monado-service",
    "libopenxr1-monado",
    "libopenxr-loader1",
    "openxr-layer-corevalidation",
    "mesa-vulkan-drivers",
];

/// The runtime and its folder.
pub(super) fn runtime() -> Unpacked {
    Unpacked {
        folder: workspace::openxr_folder(),
        release: Release::Named("trixie"),
        packages: PACKAGES,
        keep: &["usr/bin/monado-service", "usr/lib", "usr/share/vulkan"],
        size_mb: (172, 570),
    }
}
