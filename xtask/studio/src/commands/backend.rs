//! [`BackendOption`]: `--backend`, the option of the commands that compute gradients.

use clap::ValueEnum;
use program::Fault;
use refine::fit::{Backend, Cpu};

/// The option `--backend`.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(super) struct BackendOption {
    /// Back end that renders and computes gradients
    #[arg(long, value_enum, default_value_t = BackendName::Auto)]
    backend: BackendName,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum BackendName {
    /// The GPU, if there is one, else the CPU
    Auto,
    /// All CPU cores; the result is bit-identical for any number of cores
    Cpu,
    /// The GPU or a software driver; results differ from the CPU's in their last digits. Needs a build with --features gpu
    Gpu,
}

/// A back end that was opened.
pub(super) struct OpenBackend {
    pub(super) backend: Box<dyn Backend>,
    /// One sentence: what `auto` chose, and why; `None` where the user chose.
    pub(super) choice: Option<String>,
}

impl BackendOption {
    /// The option of a command that has nothing to compute on a device.
    ///
    /// # Errors
    /// [`Fault::Usage`] if a device is asked for.
    pub(super) fn unneeded(self, why: &str) -> Result<Box<dyn Backend>, Fault> {
        match self.backend {
            BackendName::Gpu => Err(Fault::Usage(format!("--backend gpu: {why}; leave it out"))),
            BackendName::Auto | BackendName::Cpu => Ok(Box::new(Cpu::default())),
        }
    }

    /// Opens the back end.
    ///
    /// # Errors
    /// [`Fault::Device`] if there is no capable device, [`Fault::Usage`] if this build has no back end for devices.
    pub(super) fn open(self) -> Result<OpenBackend, Fault> {
        Ok(match self.backend {
            BackendName::Auto => fastest(),
            BackendName::Cpu => OpenBackend { backend: Box::new(Cpu::default()), choice: None },
            BackendName::Gpu => OpenBackend { backend: open_gpu()?, choice: None },
        })
    }
}

fn by_cpu(why: &str) -> OpenBackend {
    OpenBackend { backend: Box::new(Cpu::default()), choice: Some(format!("the CPU computes: {why}")) }
}

#[cfg(feature = "gpu")]
fn fastest() -> OpenBackend {
    match refine::fit::gpu::Gpu::open() {
        Ok(gpu) if gpu.is_software() => {
            let device = gpu.device().unwrap_or_default();
            by_cpu(&format!("there is no GPU, and the software driver {device} is slower"))
        }
        Ok(gpu) => {
            let choice =
                format!("{} computes; --backend cpu chooses the CPU", gpu.device().unwrap_or_default());
            OpenBackend { backend: Box::new(gpu), choice: Some(choice) }
        }
        Err(error) => by_cpu(&error.to_string()),
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
fn fastest() -> OpenBackend {
    by_cpu("this build has no GPU back end")
}

#[cfg(not(feature = "gpu"))]
fn open_gpu() -> Result<Box<dyn Backend>, Fault> {
    Err(Fault::Usage(
        "--backend gpu: this build has no GPU back end; \
         run the command as `cargo run --release --package studio --features gpu -- ...`"
            .into(),
    ))
}
