//! The folders that the set-up makes: their packages, the files kept of each, and their sizes.

use xtask::workspace;

use super::unpacked::{Origin, Unpacked};

/// An OpenXR runtime for tests: Monado with a simulated headset and a null compositor, the OpenXR loader,
/// Khronos's validation layer and Mesa's software Vulkan driver. Few Linux releases ship a recent one, so
/// every machine uses the packages of one Debian release.
pub(super) fn headset() -> Unpacked {
    Unpacked {
        folder: workspace::openxr_folder(),
        origin: Origin::Debian("trixie"),
        packages: &[
            "monado-service",
            "libopenxr1-monado",
            "libopenxr-loader1",
            "openxr-layer-corevalidation",
            "mesa-vulkan-drivers",
        ],
        keep: &["usr/bin/monado-service", "usr/lib", "usr/share/vulkan"],
        size_mb: (172, 570),
    }
}

/// A recent Rust from Debian with the source of its standard library, a C compiler and linkers. rustup's
/// compiler needs its standard library for a target installed; Debian's can build it from source. Headers
/// and libraries of GNU/Linux on ARM stand in for Android's: what is built is for checking only.
pub(super) fn debian_rust() -> Unpacked {
    Unpacked {
        folder: workspace::debian_rust_folder(),
        origin: Origin::Machine,
        // Debian keeps `rustc-web` as new as browsers need it.
        packages: &[
            "rustc-web",
            "rust-web-src",
            "rust-web-clippy",
            "clang",
            "lld",
            "libc6-dev-arm64-cross",
            "binutils-mingw-w64-x86-64",
        ],
        keep: &["usr/bin", "usr/lib", "usr/src/*/library", "usr/aarch64-linux-gnu"],
        size_mb: (269, 1025),
    }
}

/// Slurm, a cluster scheduler: its controller, a node and the service that authenticates them.
pub(super) fn slurm() -> Unpacked {
    Unpacked {
        folder: workspace::slurm_folder(),
        origin: Origin::Machine,
        packages: &["slurmctld", "slurmd", "slurm-client", "munge"],
        keep: &[
            "usr/bin/sbatch",
            "usr/bin/scontrol",
            "usr/bin/sinfo",
            "usr/sbin/munged",
            "usr/sbin/slurmctld-wlm",
            "usr/sbin/slurmd-wlm",
            "usr/sbin/slurmstepd-wlm",
            "usr/lib",
        ],
        size_mb: (17, 28),
    }
}

/// SwiftShader, Chromium's software Vulkan driver. It needs no library but C's.
pub(super) fn swiftshader() -> Unpacked {
    Unpacked {
        folder: workspace::swiftshader_folder(),
        origin: Origin::MachineAlone,
        packages: &["chromium-common"],
        keep: &["usr/lib/chromium/libvk_swiftshader.so", "usr/lib/chromium/vk_swiftshader_icd.json"],
        size_mb: (27, 6),
    }
}

/// Emulators of other processors, and C compilers and libraries for them.
pub(super) fn foreign() -> Unpacked {
    Unpacked {
        folder: workspace::foreign_folder(),
        origin: Origin::Machine,
        packages: &[
            "qemu-user",
            "gcc-aarch64-linux-gnu",
            "gcc-arm-linux-gnueabihf",
            "gcc-powerpc64-linux-gnu",
            "libc6-dev-arm64-cross",
            "libc6-dev-armhf-cross",
            "libc6-dev-ppc64-cross",
        ],
        keep: &[
            "usr/bin",
            "usr/lib",
            "usr/aarch64-linux-gnu",
            "usr/arm-linux-gnueabihf",
            "usr/powerpc64-linux-gnu",
        ],
        size_mb: (142, 550),
    }
}

/// ONNX Runtime, as it comes for Python.
pub(super) fn onnx() -> Unpacked {
    Unpacked {
        folder: workspace::onnx_folder(),
        origin: Origin::Python,
        packages: &["onnxruntime"],
        keep: &["onnxruntime/capi", "onnxruntime/LICENSE"],
        size_mb: (28, 72),
    }
}
