//! [`Probe`]: whether a camera in a file sees the field of that file, which many do not.

use std::borrow::Cow;

use codec::{ALPHA_MIN, Camera, Field};
use refine::prune::instants;
use refine::reference::{Order, RenderScene, contributions, render};

use super::budget::ImportBudget;

/// Fraction of the pixels that the field must cover.
const COVERED_MIN: f64 = 0.01;

/// Number of Gaussians that must be visible; half of those alive where fewer than twice as many are.
const GAUSSIANS_MIN: usize = 50;

/// Number of instants, of which one must show enough.
const INSTANTS: usize = 3;

/// Size in pixels of the image that decides.
const SIZE: (u32, u32) = (64, 48);

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

    /// Whether the image of `camera` shows enough of the field at some instant: neither empty space nor the inside
    /// of one Gaussian.
    pub(super) fn shows(&self, camera: &Camera) -> bool {
        let camera = camera.resized(SIZE.0, SIZE.1);
        camera.check().is_ok() && instants(&self.0, INSTANTS).iter().any(|&t| self.shows_at(&camera, t))
    }

    fn shows_at(&self, camera: &Camera, t: f64) -> bool {
        let field = &*self.0;
        let image = render(&RenderScene::from(field), camera, t, Order::Depth);
        let covered = image.pixels.iter().filter(|pixel| pixel[3] > 0.0).count();
        if (covered as f64) < COVERED_MIN * image.pixels.len() as f64 {
            return false;
        }
        let alive = (0..field.len()).filter(|&row| field.opacity_at(row, t) >= ALPHA_MIN).count();
        let weights = contributions(field, camera, t, Order::Depth);
        let visible = weights.iter().filter(|contribution| contribution.weight_max >= ALPHA_MIN).count();
        visible >= GAUSSIANS_MIN.min(alive.div_ceil(2)).max(1)
    }
}
