//! [`Neighbors`]: the nearest of the Gaussians coded shortly before, which predict the next one.

use super::search::{LastCells, NEAREST, WINDOW};
use crate::rans::math::{self, Unit};

/// Decoded numbers of a Gaussian that predict later ones.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct History {
    /// Logarithm of the largest blurred scale, relative to the footprint, and the differences between
    /// each next logarithm and its predecessor.
    pub(super) scales: [f64; 3],
    /// Direction of the main axis.
    pub(super) direction: [f64; 3],
    pub(super) color: [f64; 3],
}

/// The last Gaussians, and the nearest of them to the current one.
#[derive(Default)]
pub(super) struct Neighbors {
    cells: LastCells,
    /// Ring buffer of the last [`WINDOW`] Gaussians.
    last: Vec<History>,
    /// Position of the next Gaussian in the ring.
    next: usize,
    /// Positions in the ring, nearest first.
    nearest: [usize; NEAREST],
    found: usize,
}

impl Neighbors {
    /// Finds the Gaussians nearest to `cell`.
    pub(super) fn find(&mut self, cell: [u32; 3]) {
        self.nearest = self.cells.nearest(cell, self.last.len());
        self.found = self.last.len().min(NEAREST);
    }

    /// The nearest Gaussian found.
    pub(super) fn nearest(&self) -> Option<&History> {
        (self.found > 0).then(|| &self.last[self.nearest[0]])
    }

    /// Mean of a number over the nearest Gaussians; `default` without any.
    pub(super) fn mean(&self, default: f64, number: impl Fn(&History) -> f64) -> f64 {
        const COUNTS: [Unit; NEAREST + 1] = [Unit::new(1.0), Unit::new(1.0), Unit::new(2.0), Unit::new(3.0)];
        if self.found == 0 {
            return default;
        }
        let sum: f64 = self.nearest[..self.found].iter().map(|&position| number(&self.last[position])).sum();
        math::in_units(sum, COUNTS[self.found])
    }

    pub(super) fn push(&mut self, cell: [u32; 3], history: History) {
        self.cells.put(self.next, cell);
        if self.last.len() < WINDOW {
            self.last.push(history);
        } else {
            self.last[self.next] = history;
        }
        self.next = (self.next + 1) % WINDOW;
    }
}
