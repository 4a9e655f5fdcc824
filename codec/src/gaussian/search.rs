//! [`LastCells`]: finds the nearest of the last cells in a ring buffer, without branches.

use crate::counters::Work;

/// Number of last Gaussians to search; they come along a Morton curve. Format.
pub(super) const WINDOW: usize = 24;

/// Number of nearest Gaussians that predict. Format.
pub(super) const NEAREST: usize = 3;

/// Coordinate of a cell that is not there yet: farther than any.
const FAR: f32 = 1e9;

/// Lower bits of a key: the position in the ring.
const POSITION: u32 = 31;

/// Coordinates of the last cells.
pub(super) struct LastCells {
    axes: [[f32; WINDOW]; 3],
}

impl Default for LastCells {
    fn default() -> LastCells {
        LastCells { axes: [[FAR; WINDOW]; 3] }
    }
}

impl LastCells {
    /// Puts a cell at a position of the ring, below [`WINDOW`].
    pub(super) fn put(&mut self, position: usize, cell: [u32; 3]) {
        for (axis, x) in self.axes.iter_mut().zip(cell) {
            axis[position] = x as f32;
        }
    }

    /// Positions of the cells nearest to `cell`, nearest first, of the first `count` of the ring. Without as many as
    /// [`NEAREST`], the last positions are undefined.
    ///
    /// Cells compare by keys: the bits of the squared distance plus 1 in binary32, whose lower bits are replaced by the
    /// position. Format.
    #[inline(always)]
    pub(super) fn nearest(&self, cell: [u32; 3], count: usize) -> [usize; NEAREST] {
        Work::Rows.count(count);
        let cell = cell.map(|x| x as f32);
        let mut keys = [0.0; WINDOW];
        for (position, key) in keys.iter_mut().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| self.axes[axis][position] - cell[axis]);
            let distance: f32 = x * x + y * y + z * z + 1.0;
            *key = f32::from_bits(distance.to_bits() & !POSITION | position as u32);
        }
        // Keys are positive, so that they compare as numbers. Three lists of 8, then of 4, 2 and 1 lanes, each lane
        // ascending from list to list.
        let lanes = |first: usize| std::array::from_fn(|lane| keys[first + lane]);
        let lists = sorted::<8>([lanes(0), lanes(8), lanes(16)]);
        let [lists]: [[[f32; 1]; 3]; 1] = [halved::<2, 1>(halved::<4, 2>(halved::<8, 4>(lists)))];
        lists.map(|[key]| (key.to_bits() & POSITION) as usize % WINDOW)
    }
}

/// Sorts each lane of three lists.
#[inline(always)]
fn sorted<const N: usize>([a, b, c]: [[f32; N]; 3]) -> [[f32; N]; 3] {
    let (a, b) = exchanged(a, b);
    let (b, c) = exchanged(b, c);
    let (a, b) = exchanged(a, b);
    [a, b, c]
}

/// The three lowest keys of each lane of the lower and the upper half.
#[inline(always)]
fn halved<const N: usize, const HALF: usize>([a, b, c]: [[f32; N]; 3]) -> [[f32; HALF]; 3] {
    let lower = |list: [f32; N]| -> [f32; HALF] { std::array::from_fn(|lane| list[lane]) };
    let upper = |list: [f32; N]| -> [f32; HALF] { std::array::from_fn(|lane| list[HALF + lane]) };
    // The three lowest numbers in two ascending lists of three are the lower numbers of opposite pairs.
    sorted([(a, c), (b, b), (c, a)].map(|(x, y)| exchanged(lower(x), upper(y)).0))
}

/// The lower and the higher number of each lane.
#[inline(always)]
fn exchanged<const N: usize>(a: [f32; N], b: [f32; N]) -> ([f32; N], [f32; N]) {
    (
        std::array::from_fn(|lane| if a[lane] < b[lane] { a[lane] } else { b[lane] }),
        std::array::from_fn(|lane| if a[lane] < b[lane] { b[lane] } else { a[lane] }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_nearest_of_all() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 48) as u32
        };
        for count in (1..=WINDOW).chain([WINDOW; 2000]) {
            let mut cells = LastCells::default();
            let all: Vec<[u32; 3]> = (0..count).map(|_| [0; 3].map(|_| random())).collect();
            all.iter().enumerate().for_each(|(position, &cell)| cells.put(position, cell));
            let cell = [0; 3].map(|_| random());
            let distance = |position: usize| -> u64 {
                (0..3).map(|axis| u64::from(all[position][axis].abs_diff(cell[axis])).pow(2)).sum()
            };
            let mut expected: Vec<usize> = (0..count).collect();
            expected.sort_by_key(|&position| distance(position));
            let found = cells.nearest(cell, count);
            for (found, expected) in found.into_iter().zip(expected) {
                // Keys have 18 bits of the distance.
                let [found, expected] = [found, expected].map(|position| distance(position) as f64);
                assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
            }
        }
    }
}
