//! [`Imported`]: a field read from a file, with the hints and the account that readers return beside it.

use codec::{Field, NEAR_OF_SIZE, Surroundings, Viewpoint};

use crate::account::{Account, Repairs, TRUNCATED};
use crate::similarity::Similarity;
use crate::up_axis::DEFAULT_UP;

/// A field read from a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The field, valid ([`Field::check`]) and with at least one Gaussian.
    pub field: Field,
    /// Metadata of the clip.
    pub hints: Hints,
    /// Name of the file's format.
    pub format: &'static str,
    /// What was repaired, assumed and lost.
    pub account: Account,
}

impl Imported {
    /// A field of a file that states no metadata and leaves nothing open.
    pub fn new(format: &'static str, field: Field, repairs: Repairs) -> Imported {
        Imported { field, hints: Hints::default(), format, account: repairs.into() }
    }

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

    /// Moves the field to be relative to another origin in the file.
    pub(crate) fn move_origin(&mut self, origin: [f64; 3]) {
        let own = self.hints.origin.unwrap_or_default();
        let translation = [0, 1, 2].map(|axis| own[axis] - origin[axis]);
        Similarity { translation, ..Similarity::IDENTITY }.apply(&mut self.field);
        self.hints.origin = (origin != [0.0; 3]).then_some(origin);
    }

    /// Checks that at least half of the announced rows are in the file. With fewer, the header or the file is
    /// damaged, and the rest does not stand for the whole.
    ///
    /// # Errors
    /// One sentence with both numbers.
    pub(crate) fn check_complete(&self) -> Result<(), String> {
        let rows = self.field.len();
        match self.account.repairs.dropped.get(TRUNCATED) {
            Some(&missing) if missing > rows => Err(format!(
                "truncated payload: the header announces {} Gaussians and the file holds {rows}",
                rows.saturating_add(missing)
            )),
            _ => Ok(()),
        }
    }

    /// The sentence for a field without rows: there were none, or why all were dropped.
    pub(crate) fn no_gaussians(&self) -> String {
        let reason = match self.account.repairs.dropped.is_empty() {
            true => "no Gaussians".into(),
            false => format!("no usable Gaussians: {}", self.account.repairs),
        };
        format!("{reason}; get the file again, or export it again")
    }
}

/// Metadata of the clip that the file states or its format implies; `None` if neither does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hints {
    /// Unit vector of the source's axes that points up.
    pub up: Option<[f32; 3]>,
    /// Coordinates of the field's origin in the file; `None` if they are zeros.
    pub origin: Option<[f64; 3]>,
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
    /// Further comments of a field file, by their keys, in order: comments on its fit, and unknown ones.
    pub comments: Vec<(String, String)>,
}
