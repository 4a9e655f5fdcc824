//! [`Probe`]: whether a camera in a file sees the field of that file, which many do not.

use std::borrow::Cow;

use codec::{Camera, Field};
use refine::prune::{PosedView, instants, is_informative};

use super::budget::ImportBudget;

/// Number of instants, of which one must show enough.
const INSTANTS: usize = 3;

/// Most rows that are drawn; a larger field is thinned.
const ROWS_MAX: usize = 100_000;

/// Memory for drawing a row, in bytes, with its copy.
const BYTES_PER_ROW: u64 = 1024;

/// A field to point cameras at.
pub(super) struct Probe<'a>(Cow<'a, Field>);

impl<'a> Probe<'a> {
    /// # Errors
    /// If drawing the field exceeds `budget`.
    pub(super) fn new(field: &'a Field, budget: &mut ImportBudget) -> Result<Probe<'a>, String> {
        let step = field.len().div_ceil(ROWS_MAX).max(1);
        budget.spend((field.len() / step) as u64 * BYTES_PER_ROW)?;
        Ok(Probe(match step {
            1 => Cow::Borrowed(field),
            _ => Cow::Owned(field.select(&(0..field.len()).step_by(step).collect::<Vec<_>>())),
        }))
    }

    /// Whether the image of `camera` shows enough of the field at some instant, see [`is_informative`].
    pub(super) fn shows(&self, camera: &Camera) -> bool {
        let view = |t| PosedView { camera: camera.clone(), t };
        instants(&self.0, INSTANTS).into_iter().any(|t| is_informative(&self.0, &view(t)))
    }
}
