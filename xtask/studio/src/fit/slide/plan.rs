//! [`SlidePlan`]: the settings of a sliding fit.

use serde::{Deserialize, Serialize};

use crate::fit::plan::FitPlan;

/// Settings that determine the result of a sliding fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlidePlan {
    /// Settings of the fit of a part: the numbers of steps and Gaussians are a part's.
    pub fit: FitPlan,
    /// Length of a part in seconds.
    pub unit_s: f64,
}
