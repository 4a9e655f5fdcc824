//! [`Neighbors`]: the nearest of the Gaussians coded shortly before, which predict the next one.

use crate::counters::Work;

/// Number of last Gaussians to search; they come along a Morton curve. Format.
const WINDOW: usize = 24;

/// Number of nearest Gaussians that predict. Format.
const NEAREST: usize = 3;

/// Decoded numbers of a Gaussian that predict later ones.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct History {
    pub(super) cell: [u32; 3],
    /// Logarithm of the largest blurred scale, relative to the footprint, and the differences between
    /// each next one and the one before.
    pub(super) scales: [f64; 3],
    /// Direction of the main axis.
    pub(super) direction: [f64; 3],
    pub(super) color: [f64; 3],
}

/// The last Gaussians, and the nearest of them to the current one.
#[derive(Default)]
pub(super) struct Neighbors {
    /// Ring buffer of the last [`WINDOW`] Gaussians.
    last: Vec<History>,
    /// Position of the next Gaussian in the ring.
    next: usize,
    /// Positions in the ring, nearest first.
    nearest: [usize; NEAREST],
    found: usize,
}

impl Neighbors {
    /// Finds the Gaussians nearest to `cell`; at equal distances the later ones.
    pub(super) fn find(&mut self, cell: [u32; 3]) {
        Work::Rows.count(self.last.len());
        let mut best = [(u64::MAX, 0); NEAREST];
        for age in 1..=self.last.len() {
            let position = if age <= self.next { self.next - age } else { self.next + WINDOW - age };
            let other = self.last[position].cell;
            let distance = (0..3).map(|axis| u64::from(cell[axis].abs_diff(other[axis])).pow(2)).sum();
            if distance >= best[NEAREST - 1].0 {
                continue;
            }
            let mut candidate = (distance, position);
            for slot in &mut best {
                if candidate.0 < slot.0 {
                    std::mem::swap(slot, &mut candidate);
                }
            }
        }
        self.nearest = best.map(|(_, position)| position);
        self.found = self.last.len().min(NEAREST);
    }

    /// The nearest Gaussian found.
    pub(super) fn nearest(&self) -> Option<&History> {
        (self.found > 0).then(|| &self.last[self.nearest[0]])
    }

    /// Mean of a number over the nearest Gaussians; `default` without any.
    pub(super) fn mean(&self, default: f64, number: impl Fn(&History) -> f64) -> f64 {
        if self.found == 0 {
            return default;
        }
        let sum: f64 = self.nearest[..self.found].iter().map(|&position| number(&self.last[position])).sum();
        sum / self.found as f64
    }

    pub(super) fn push(&mut self, history: History) {
        if self.last.len() < WINDOW {
            self.last.push(history);
        } else {
            self.last[self.next] = history;
        }
        self.next = (self.next + 1) % WINDOW;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_nearest_of_the_last_ones() {
        let mut neighbors = Neighbors::default();
        neighbors.find([0; 3]);
        assert!(neighbors.nearest().is_none());
        assert_eq!(neighbors.mean(7.0, |_| 1.0), 7.0);
        for i in 0..100u32 {
            neighbors.find([i, 0, 0]);
            neighbors.push(History { cell: [i, 0, 0], color: [f64::from(i); 3], ..History::default() });
        }
        neighbors.find([80, 0, 0]);
        assert_eq!(neighbors.nearest().unwrap().cell[0], 80);
        assert_eq!(neighbors.mean(0.0, |history| history.color[0]), 80.0);
        // Gaussian 3 has left the window.
        neighbors.find([3, 0, 0]);
        assert_eq!(neighbors.nearest().unwrap().cell[0], 76);
    }
}
