//! [`Imported`]: a field read from a file, with the hints and repairs that importers return beside it.

use std::collections::BTreeMap;
use std::fmt;

use codec::{Field, NEAR_OF_SIZE, SH_C0, Surroundings, Viewpoint};

use crate::up_axis::DEFAULT_UP;

/// The reason of [`Repairs::dropped`] for rows that the header announces and the file lacks.
pub(crate) const TRUNCATED: &str = "truncated payload";

/// A field read from a file.
#[derive(Debug)]
pub struct Imported {
    /// The field, valid ([`Field::check`]) and with at least one Gaussian.
    pub field: Field,
    /// Metadata of the clip.
    pub hints: Hints,
    /// Changes made to satisfy the field's invariants.
    pub repairs: Repairs,
    /// Name of the file's format.
    pub format: &'static str,
    /// What the importer assumed where the format is silent and programs differ, what it left out, and what it made of
    /// a sequence; each the rest of a note that names the file.
    pub notes: Vec<String>,
}

impl Imported {
    /// The field with the near distance that its file states, or with a share of the size of its content. So Gaussians
    /// right before the eye fade, in any unit.
    pub(crate) fn with_near(mut self) -> Imported {
        let near = self.hints.near.unwrap_or_else(|| {
            let up = self.hints.up.unwrap_or(DEFAULT_UP);
            (NEAR_OF_SIZE * 2.0 * Surroundings::new(&self.field, None, up).content_radius()) as f32
        });
        self.field.near = if near.is_finite() { near } else { 0.0 };
        self
    }

    /// Checks that at least half of the announced rows are in the file. With fewer, the header or the file is
    /// damaged, and the rest does not stand for the whole.
    ///
    /// # Errors
    /// One sentence with both numbers.
    pub(crate) fn check_complete(&self) -> Result<(), String> {
        let rows = self.field.len();
        match self.repairs.dropped.get(TRUNCATED) {
            Some(&missing) if missing > rows => Err(format!(
                "truncated payload: the header announces {} Gaussians and the file holds {rows}",
                rows.saturating_add(missing)
            )),
            _ => Ok(()),
        }
    }

    /// The sentence for a field without rows: there were none, or why all were dropped.
    pub(crate) fn no_gaussians(&self) -> String {
        let reason = match self.repairs.dropped.is_empty() {
            true => "no Gaussians".into(),
            false => format!("no usable Gaussians: {}", self.repairs),
        };
        format!("{reason}; get the file again, or export it again")
    }
}

/// Metadata of the clip that the file states or its format implies; `None` if neither does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hints {
    /// Unit vector of the source's axes that points up.
    pub up: Option<[f32; 3]>,
    /// Metres per unit of the source.
    pub metres_per_unit: Option<f32>,
    /// [`Field::near`]; 0 if nothing fades near an eye.
    pub near: Option<f32>,
    /// Length of the clip in seconds.
    pub duration_s: Option<f32>,
    /// Captured frames per second.
    pub fps: Option<f32>,
    /// Suggested viewpoints, the initial one first.
    pub viewpoints: Vec<Viewpoint>,
    /// Number of frames of a sequence: its clip lasts one frame less, at any frame rate.
    pub frames: Option<usize>,
    /// Further comments of a field file, by their keys, in order: those on its fit, and unknown ones.
    pub comments: Vec<(String, String)>,
}

/// Rows repaired or dropped on import, counted by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Reason to number of repaired rows.
    pub repaired: BTreeMap<&'static str, usize>,
    /// Reason to number of dropped rows.
    pub dropped: BTreeMap<&'static str, usize>,
}

impl Repairs {
    /// Whether no row was changed.
    pub fn is_empty(&self) -> bool {
        self.repaired.is_empty() && self.dropped.is_empty()
    }

    /// Those of a table that ends `rows` rows early.
    pub(crate) fn of_truncated(rows: usize) -> Repairs {
        let mut repairs = Repairs::default();
        repairs.drop_rows(TRUNCATED, rows);
        repairs
    }

    /// Adds the counts of another file.
    pub(crate) fn add(&mut self, other: &Repairs) {
        other.repaired.iter().for_each(|(reason, &rows)| self.repair_rows(reason, rows));
        other.dropped.iter().for_each(|(reason, &rows)| self.drop_rows(reason, rows));
    }

    pub(crate) fn repair_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.repaired.entry(reason).or_default() += rows;
        }
    }

    pub(crate) fn drop_rows(&mut self, reason: &'static str, rows: usize) {
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

/// The constant SH coefficient of a channel with this value in `[0, 1]`.
pub(crate) fn sh_of_rgb(value: f64) -> f32 {
    ((value - 0.5) / SH_C0) as f32
}

/// The logarithms of standard deviations. Zero, the result of underflow in formats with few bits,
/// becomes the smallest positive [`half::f16`].
pub(crate) fn log_of_scales(scales: [f32; 3], repairs: &mut Repairs) -> [f32; 3] {
    repairs.repair_rows("zero scale", usize::from(scales.contains(&0.0)));
    scales.map(|scale| if scale == 0.0 { half::f16::from_bits(1).to_f32() } else { scale }.ln())
}
