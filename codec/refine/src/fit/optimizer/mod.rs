//! Adam: its moments, its step, the learning rates, and the term of the loss that depends on sizes alone.

mod adam;
mod learning_rates;
mod moments;
mod size_penalty;

pub(super) use adam::adam;
#[cfg(all(test, feature = "gpu"))]
pub(super) use adam::{BETA1, BETA2, EPSILON};
pub(super) use learning_rates::{LearningRates, decay};
pub(super) use moments::Moments;
pub(super) use size_penalty::{SIZE_PENALTY, add_size_penalty};
