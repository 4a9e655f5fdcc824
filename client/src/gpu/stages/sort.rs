//! Stage `sort`: orders rows back to front.
//!
//! A stable radix sort of 32-bit depth keys, 11 bits per pass, that reuses its memory.

/// Bits per digit.
pub const DIGIT_BITS: u32 = 11;

/// Digits per key.
pub const DIGITS: usize = 3;

const BUCKETS: usize = 1 << DIGIT_BITS;

/// The bit of a row that is in the inset of a foveated frame. Buffers hold fewer rows than that.
const INSET: u32 = 1 << 31;

/// A sort key in the upper half and its row in the lower half, with the mark of the inset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gpu) struct Item(u64);

impl Item {
    /// `depth` must not be NaN.
    pub(in crate::gpu) fn new(depth: f32, row: u32) -> Item {
        // Floats sort like sign-magnitude integers; this maps them to unsigned ones.
        let bits = depth.to_bits();
        let key = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
        Item(u64::from(key) << 32 | u64::from(row))
    }

    /// Marks the row as being in the inset.
    pub(in crate::gpu) fn in_inset(self) -> Item {
        Item(self.0 | u64::from(INSET))
    }

    /// Splits a row that was sorted into its number and whether it is in the inset.
    pub(in crate::gpu) fn split(row: u32) -> (u32, bool) {
        (row & !INSET, row & INSET != 0)
    }

    fn row(self) -> u32 {
        self.0 as u32
    }

    fn digit(self, digit: usize) -> usize {
        (self.0 >> (32 + digit as u32 * DIGIT_BITS)) as usize % BUCKETS
    }
}

/// The memory of the sort.
pub(in crate::gpu) struct Sorter {
    scratch: Vec<Item>,
    counts: Box<[[u32; BUCKETS]; DIGITS]>,
}

impl Sorter {
    /// A sorter of up to `capacity` items without further allocation.
    pub(in crate::gpu) fn new(capacity: usize) -> Sorter {
        Sorter { scratch: Vec::with_capacity(capacity), counts: Box::new([[0; BUCKETS]; DIGITS]) }
    }

    /// Replaces `order` by the rows of `items` from the farthest to the nearest. Among equal depths, the
    /// first item counts as nearest. Rows keep their marks. Leaves `items` in unspecified order.
    pub(in crate::gpu) fn sort(&mut self, items: &mut Vec<Item>, order: &mut Vec<u32>) {
        self.count(items);
        self.scratch.resize(items.len(), Item(0));
        for digit in 0..DIGITS {
            let counts = &mut self.counts[digit];
            // All items share the digit: they are sorted by it.
            if counts.iter().any(|&count| count as usize == items.len()) {
                continue;
            }
            let mut next = 0;
            for count in counts.iter_mut() {
                let start = next;
                next += *count;
                *count = start;
            }
            for &item in items.iter() {
                let place = &mut counts[item.digit(digit)];
                self.scratch[*place as usize] = item;
                *place += 1;
            }
            std::mem::swap(items, &mut self.scratch);
        }
        order.clear();
        order.extend(items.iter().rev().map(|item| item.row()));
    }

    /// Histogram of each digit.
    fn count(&mut self, items: &[Item]) {
        self.counts.iter_mut().for_each(|counts| counts.fill(0));
        for item in items {
            for (digit, counts) in self.counts.iter_mut().enumerate() {
                counts[item.digit(digit)] += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(depths: &[f32]) -> Vec<u32> {
        let mut items: Vec<Item> =
            depths.iter().zip(0..).map(|(&depth, row)| Item::new(depth, row)).collect();
        let mut order = Vec::new();
        Sorter::new(depths.len()).sort(&mut items, &mut order);
        order
    }

    /// Rows by a stable sort by depth, reversed.
    fn expected(depths: &[f32]) -> Vec<u32> {
        let mut rows: Vec<u32> = (0..depths.len() as u32).collect();
        rows.sort_by(|&a, &b| depths[a as usize].total_cmp(&depths[b as usize]));
        rows.reverse();
        rows
    }

    #[test]
    fn farthest_first_and_first_among_equals_nearest() {
        assert_eq!(sorted(&[1.0, 3.0, 2.0, 3.0, 1.0]), [3, 1, 2, 4, 0]);
        assert!(sorted(&[]).is_empty());
        assert_eq!(sorted(&[7.0; 4]), [3, 2, 1, 0]);
    }

    #[test]
    fn any_floats() {
        let special = [0.0, -0.0, 1e-40, -1e-40, f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, -2.5];
        assert_eq!(sorted(&special), expected(&special));
    }

    #[test]
    fn many_items_with_ties() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            // Few distinct values near 5, so that ties and shared digits occur.
            5.0 + (state >> 20) as f32 * 1e-3
        };
        let depths: Vec<f32> = (0..20_000).map(|_| random()).collect();
        assert_eq!(sorted(&depths), expected(&depths));
    }

    #[test]
    fn rows_keep_their_marks() {
        let mut items = vec![Item::new(1.0, 5).in_inset(), Item::new(2.0, 6), Item::new(-3.0, 7).in_inset()];
        let mut order = Vec::new();
        Sorter::new(3).sort(&mut items, &mut order);
        let rows: Vec<_> = order.into_iter().map(Item::split).collect();
        assert_eq!(rows, [(6, false), (5, true), (7, true)]);
    }

    #[test]
    fn memory_is_reused() {
        let mut items: Vec<Item> = (0..1000).map(|row| Item::new(row as f32, row)).collect();
        let mut order = Vec::with_capacity(1000);
        let mut sorter = Sorter::new(1000);
        sorter.sort(&mut items, &mut order);
        let capacities = (items.capacity(), order.capacity(), sorter.scratch.capacity());
        items.truncate(10);
        sorter.sort(&mut items, &mut order);
        assert_eq!(order, [9, 8, 7, 6, 5, 4, 3, 2, 1, 0]);
        let mut after = [items.capacity(), sorter.scratch.capacity()];
        after.sort_unstable();
        assert_eq!((after[0], order.capacity(), after[1]), capacities);
    }
}
