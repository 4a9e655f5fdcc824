//! Adam: its moments, its step, the learning rates, and the term of the loss that depends on sizes alone.

mod adam;
mod fragment_term;
mod learning_rates;
mod moments;

pub(super) use adam::{BETA1, BETA2, EPSILON, adam};
pub(super) use fragment_term::add_fragment_term;
pub(super) use learning_rates::{LearningRates, decay};
#[cfg(all(test, feature = "gpu"))]
pub(super) use learning_rates::{REACH_MIN, SUPPORT_RADIUS};
pub(super) use moments::Moments;
