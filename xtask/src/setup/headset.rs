//! An OpenXR runtime for tests: Monado with a simulated headset and a compositor that shows nothing,
//! the OpenXR loader, Khronos's validation layer and Mesa's software Vulkan driver.
//!
//! Few releases of Linux systems carry a recent one, so it comes from one release of Debian for all.

use xtask::workspace;

use super::unpacked::{Release, Unpacked};

/// What the tests start and load.
const PACKAGES: &[&str] = &[
    "monado-service",
    "libopenxr1-monado",
    "libopenxr-loader1",
    "openxr-layer-corevalidation",
    "mesa-vulkan-drivers",
];

/// The runtime in its folder.
pub(super) fn runtime() -> Unpacked {
    Unpacked {
        folder: workspace::openxr_folder(),
        release: Release::Named("trixie"),
        packages: PACKAGES,
        keep: &["usr/bin/monado-service", "usr/lib", "usr/share/vulkan"],
        size_mb: (172, 570),
    }
}
