//! The back ends: [`Backend`], which renders, backpropagates and steps, on the CPU ([`cpu`]) and on
//! graphics devices (`gpu`).

pub mod cpu;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
mod gradient;
mod interface;

pub use error::DeviceError;
pub use gradient::Gradient;
pub use interface::{Backend, PixelGradients, StepConfig, StepReport, TrainingState};
