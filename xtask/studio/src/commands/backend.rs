//! [`BackendOption`]: `--backend`, the option of the commands that compute gradients.

use clap::ValueEnum;
use program::Fault;
use refine::fit::{Backend, Cpu};

/// The option `--backend`.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(super) struct BackendOption {
    /// Back end that renders and computes gradients
    #[arg(long, value_enum, default_value_t = BackendName::Cpu)]
    backend: BackendName,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum BackendName {
    /// All CPU cores; the result is bit-identical for any number of cores
    Cpu,
    /// The GPU; results differ from the CPU's in their last digits. Needs a build with --features gpu
    Gpu,
}

impl BackendOption {
    /// Opens the back end.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is no capable device, [`Fault::Usage`] if this build has no back end for devices.
    pub(super) fn open(self) -> Result<Box<dyn Backend>, Fault> {
        match self.backend {
            BackendName::Cpu => Ok(Box::new(Cpu::default())),
            BackendName::Gpu => open_gpu(),
        }
    }
}

#[cfg(feature = "gpu")]
fn open_gpu() -> Result<Box<dyn Backend>, Fault> {
    match refine::fit::gpu::Gpu::open() {
        Ok(gpu) => Ok(Box::new(gpu)),
        Err(error) => Err(Fault::Device(error.to_string())),
    }
}

#[cfg(not(feature = "gpu"))]
fn open_gpu() -> Result<Box<dyn Backend>, Fault> {
    Err(Fault::Usage(
        "--backend gpu: this build has no GPU back end; \
         run the command as `cargo run --release --package studio --features gpu -- ...`"
            .into(),
    ))
}
