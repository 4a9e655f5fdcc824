//! [`LastCells`]: finds the nearest of the last cells by exact distances.

use crate::{
    counters::Work,
    gaussian::{NEAREST, Search, WINDOW},
};

/// The last cells. Format: at equal distances the later ones are nearer.
#[derive(Default)]
pub(super) struct LastCells {
    cells: [[u32; 3]; WINDOW],
}

impl Search for LastCells {
    fn put(&mut self, position: usize, cell: [u32; 3]) {
        self.cells[position] = cell;
    }

    fn nearest(&self, cell: [u32; 3], count: usize, next: usize) -> [usize; NEAREST] {
        Work::Rows.count(count);
        let mut best = [(u64::MAX, 0); NEAREST];
        for age in 1..=count {
            let position = if age <= next { next - age } else { next + WINDOW - age };
            let other = self.cells[position];
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
        best.map(|(_, position)| position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_nearest_of_the_last_ones() {
        let mut cells = LastCells::default();
        for i in 0..100 {
            cells.put(i % WINDOW, [i as u32, 0, 0]);
        }
        let nearest = |x: u32| cells.nearest([x, 0, 0], WINDOW, 100 % WINDOW);
        // Of equal distances the later.
        assert_eq!(nearest(80), [80 % WINDOW, 81 % WINDOW, 79 % WINDOW]);
        // Gaussian 3 has left the window.
        assert_eq!(nearest(3), [76 % WINDOW, 77 % WINDOW, 78 % WINDOW]);
        assert_eq!(cells.nearest([0; 3], 3, 3), [0, 1, 2], "only the first 3");
    }
}
