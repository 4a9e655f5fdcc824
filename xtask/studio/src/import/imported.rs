//! [`Imported`]: a field read from a file, with the hints and repairs that importers return beside it.

use std::collections::BTreeMap;
use std::fmt;

use codec::{Field, SH_C0, Viewpoint};
use refine::capture::Holdout;

/// Most Gaussians accepted from a compressed file, whose size does not bound their number.
pub(super) const GAUSSIANS_MAX: usize = 1 << 24;

/// A field read from a file.
#[derive(Debug)]
pub struct Imported {
    /// The field, with its invariants kept ([`Field::check`]) and at least one Gaussian.
    pub field: Field,
    /// What is known about the clip.
    pub hints: Hints,
    /// What was changed to keep the field's invariants.
    pub repairs: Repairs,
    /// Name of the file's format.
    pub format: &'static str,
}

/// What a file says, or its format implies, about the clip; `None` where it does not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hints {
    /// Unit vector of the source's axes that points up.
    pub up: Option<[f32; 3]>,
    /// Metres per unit of the source.
    pub metres_per_unit: Option<f32>,
    /// Length of the clip in seconds.
    pub duration_s: Option<f32>,
    /// Captured frames per second.
    pub fps: Option<f32>,
    /// Suggested viewpoints, the one to start from first.
    pub viewpoints: Vec<Viewpoint>,
    /// Frames that were held out from fitting.
    pub holdout: Option<Holdout>,
}

/// Rows changed or left out on import, counted by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Reason to number of rows that were changed and kept.
    pub repaired: BTreeMap<&'static str, usize>,
    /// Reason to number of rows that were left out.
    pub dropped: BTreeMap<&'static str, usize>,
}

impl Repairs {
    /// Whether the file was in order.
    pub fn is_empty(&self) -> bool {
        self.repaired.is_empty() && self.dropped.is_empty()
    }

    pub(super) fn repair_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.repaired.entry(reason).or_default() += rows;
        }
    }

    pub(super) fn drop_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.dropped.entry(reason).or_default() += rows;
        }
    }
}

/// One line, such as `repaired 3 (zero quaternion: 3), dropped 1 (non-finite centre: 1)`, or
/// `nothing to repair`.
impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = |verb: &str, counts: &BTreeMap<&'static str, usize>| {
            let reasons: Vec<String> = counts.iter().map(|(reason, n)| format!("{reason}: {n}")).collect();
            (!counts.is_empty())
                .then(|| format!("{verb} {} ({})", counts.values().sum::<usize>(), reasons.join(", ")))
        };
        let parts: Vec<String> = [part("repaired", &self.repaired), part("dropped", &self.dropped)]
            .into_iter()
            .flatten()
            .collect();
        f.write_str(if parts.is_empty() { "nothing to repair" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

/// The constant SH coefficient of a channel that has this value in `[0, 1]` from all sides.
pub(super) fn sh_of_rgb(value: f64) -> f32 {
    ((value - 0.5) / SH_C0) as f32
}

/// The logarithms of standard deviations. Zero, which small ones underflow to where they are
/// stored in few bits, becomes the smallest positive [`half::f16`].
pub(super) fn log_of_scales(scales: [f32; 3], repairs: &mut Repairs) -> [f32; 3] {
    repairs.repair_rows("zero scale", usize::from(scales.contains(&0.0)));
    scales.map(|scale| if scale == 0.0 { half::f16::from_bits(1).to_f32() } else { scale }.ln())
}
