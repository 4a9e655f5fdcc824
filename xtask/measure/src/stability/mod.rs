//! Stability: the GPU's images of stiff and extreme fields against the f64 reference's.
//!
//! A case is data: a field, views, and the largest allowed deviation from the reference. [`cases`] lists them,
//! [`run()`] measures one, and [`run_suite`] measures all. `cargo xtask report --stability` prints the results as a
//! table; the test `stability` runs the same cases.
//!
//! The GPU draws the field itself, because a package can hold few of these fields. Fields that a package can hold
//! are also drawn from packages by each coder; the encoder must refuse the others. A take is drawn segment by segment,
//! and compared with its field unsplit.

mod amount;
mod case;
mod gaussians;
mod precision;
mod result;
mod run;
mod space;
mod suite;
mod takes;
mod time;

pub use case::{DeviationKind, PackageExpectation, StabilityCase, StabilityScene, TakeScene};
pub use precision::along;
pub use result::CaseResult;
pub use run::run;
pub use suite::run_suite;

/// All cases that need no file.
pub fn cases() -> Vec<StabilityCase> {
    [time::cases(), space::cases(), amount::cases(), precision::cases(), takes::cases()]
        .into_iter()
        .flatten()
        .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_are_unique_and_bounds_are_bounds() {
        let cases = cases();
        let names: BTreeSet<&str> = cases.iter().map(|case| case.name.as_str()).collect();
        assert_eq!(names.len(), cases.len());
        assert!(cases.iter().all(|case| case.bound > 0.0 && case.bound < 8.0 && !case.how.is_empty()));
    }
}
