//! The optimisation loop: [`Fit`] is the state of a fit as a value that can be saved, [`Run`] takes its
//! steps on a back end.

mod fit;
mod run;

pub use fit::{FRAGMENT_WEIGHT, Fit, FitSettings};
pub use run::Run;
