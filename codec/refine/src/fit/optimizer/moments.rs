//! [`Moments`]: Adam's memory of the gradients.

use serde::{Deserialize, Serialize};

use crate::fit::parameters::{Carried, Parameters};
use crate::raster::Real;

/// Adam's moments of the rows of some parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::fit) struct Moments<T> {
    /// First moments: exponentially decaying means of the gradients.
    pub(in crate::fit) first: Parameters<T>,
    /// Second moments: the same of their squares.
    pub(in crate::fit) second: Parameters<T>,
    /// Number of gradients that each row has had.
    pub(in crate::fit) visits: Vec<u32>,
    /// The past of each row, in a fit that goes on from earlier ones; else empty.
    pub(in crate::fit) carried: Vec<Carried>,
}

impl<T: Real> Moments<T> {
    /// The moments of parameters that have not moved yet: zeros.
    pub(in crate::fit) fn new(parameters: &Parameters<T>) -> Moments<T> {
        let rows = parameters.len();
        Moments {
            first: parameters.zeros(rows),
            second: parameters.zeros(rows),
            visits: vec![0; rows],
            carried: Vec::new(),
        }
    }

    /// Copies `rows`, in that order; a row may occur more than once.
    pub(in crate::fit) fn select(&self, rows: &[usize]) -> Moments<T> {
        Moments {
            first: self.first.select(rows),
            second: self.second.select(rows),
            visits: rows.iter().map(|row| self.visits[*row]).collect(),
            carried: rows.iter().filter_map(|row| self.carried.get(*row).copied()).collect(),
        }
    }

    /// Whether a row stands still and is always on.
    pub(in crate::fit) fn is_static(&self, row: usize) -> bool {
        self.carried.get(row).is_some_and(|carried| carried.is_static)
    }

    /// Whether no other fit has a part in a row.
    pub(in crate::fit) fn is_own(&self, row: usize) -> bool {
        self.carried.get(row).is_none_or(|carried| carried.is_own())
    }

    /// Resets a row to zeros.
    pub(in crate::fit) fn clear(&mut self, row: usize) {
        for numbers in self.first.row_mut(row).into_iter().chain(self.second.row_mut(row)) {
            numbers.fill(T::zero());
        }
        self.visits[row] = 0;
    }
}
