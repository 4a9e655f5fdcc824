//! Slurm, a cluster scheduler, for the test of job arrays: its controller, a node and the service that
//! authenticates them.

use xtask::workspace;

use super::unpacked::{Release, Unpacked};

/// Packages that the test starts.
const PACKAGES: &[&str] = &["slurmctld", "slurmd", "slurm-client", "munge"];

/// The scheduler and its folder.
pub(super) fn scheduler() -> Unpacked {
    Unpacked {
        folder: workspace::slurm_folder(),
        release: Release::Machine,
        packages: PACKAGES,
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
