//! The programs as users run them: command lines, windows, downloads, playlists, job arrays, and
//! machines that fail.

use std::process::ExitCode;

use aarc_tests::gpu;

mod apk;
mod cli;
mod dist;
mod failures;
mod faults;
mod headset;
mod job_array;
mod net_programs;
mod playlist;
mod takes;
mod window;
mod workshop;

fn main() -> ExitCode {
    gpu::run([
        // First, because it takes longest and mostly waits.
        ("job_array", job_array::trials()),
        ("apk", apk::trials()),
        ("cli", cli::trials()),
        ("dist", dist::trials()),
        ("failures", failures::trials()),
        ("faults", faults::trials()),
        ("headset", headset::trials()),
        ("net_programs", net_programs::trials()),
        ("playlist", playlist::trials()),
        ("takes", takes::trials()),
        ("window", window::trials()),
    ])
}
