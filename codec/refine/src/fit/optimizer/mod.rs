//! Adam: its moments, its step and the learning rates.

mod adam;
mod learning_rates;
mod moments;

pub(super) use adam::adam;
#[cfg(all(test, feature = "gpu"))]
pub(super) use adam::{BETA1, BETA2, EPSILON};
pub(super) use learning_rates::{LearningRates, decay};
pub(super) use moments::Moments;
