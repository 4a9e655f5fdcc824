//! [`ScreenGradients`]: the screen-space gradient accumulator that densification is decided by.

use serde::{Deserialize, Serialize};

use crate::raster::Real;

/// Sums of the norms of the screen-space gradients since the last control, one per Gaussian.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::fit) struct ScreenGradients {
    /// Sums of the norms.
    pub(in crate::fit) sums: Vec<f32>,
    /// Number of images that showed each Gaussian.
    pub(in crate::fit) images: Vec<u32>,
}

impl ScreenGradients {
    /// Empty sums for `gaussians` Gaussians.
    pub(in crate::fit) fn zeros(gaussians: usize) -> ScreenGradients {
        ScreenGradients { sums: vec![0.0; gaussians], images: vec![0; gaussians] }
    }

    /// Adds one image: the rows that it shows and their
    /// [screen-space gradients](crate::fit::Gradient::screen). A non-finite one counts as 0.
    ///
    /// # Panics
    /// If the two differ in length.
    pub(in crate::fit) fn accumulate<T: Real>(&mut self, rows: &[u32], norms: &[T]) {
        assert_eq!(rows.len(), norms.len(), "a gradient for each row");
        for (row, norm) in rows.iter().zip(norms) {
            self.sums[*row as usize] += if norm.is_finite() { norm.to_double() as f32 } else { 0.0 };
            self.images[*row as usize] += 1;
        }
    }

    /// Mean over the images that showed a row; 0 without any.
    pub(super) fn mean(&self, row: usize) -> f64 {
        f64::from(self.sums[row]) / f64::from(self.images[row].max(1))
    }
}
