//! Stage `sort`: back to front.
//!
//! A radix sort of depths, 11 bits a pass, stable. It reuses its memory. Two passes do: the bits of
//! floats rise with them, evenly within an octave, so of what lies between the nearest and the
//! farthest Gaussian the upper 22 bits tell depths apart to a few millionths of themselves where it
//! spans decades, and to less than a millionth where it spans an octave or two.

/// Bits of a digit; two digits cover a key.
const DIGIT_BITS: u32 = 11;
const BUCKETS: usize = 1 << DIGIT_BITS;
const DIGITS: usize = 2;

/// A row and the depth that it is sorted by: the depth, as an integer, in the upper half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gpu) struct Item(u64);

impl Item {
    /// `depth` must not be NaN.
    pub(in crate::gpu) fn new(depth: f32, row: u32) -> Item {
        // Floats order like sign-magnitude integers: this maps them to unsigned ones.
        let bits = depth.to_bits();
        let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
        Item(u64::from(ordered) << 32 | u64::from(row))
    }

    fn row(self) -> u32 {
        self.0 as u32
    }

    fn ordered(self) -> u32 {
        (self.0 >> 32) as u32
    }
}

/// What of the depths of some items is sorted by.
#[derive(Clone, Copy)]
struct Key {
    nearest: u32,
    /// Lower bits that are left out.
    shift: u32,
}

impl Key {
    fn new(items: &[Item]) -> Key {
        let range = |[low, high]: [u32; 2], item: &Item| [low.min(item.ordered()), high.max(item.ordered())];
        let [nearest, farthest] = items.iter().fold([u32::MAX, 0], range);
        let bits = u32::BITS - farthest.saturating_sub(nearest).leading_zeros();
        Key { nearest, shift: bits.saturating_sub(DIGITS as u32 * DIGIT_BITS) }
    }

    fn digit(self, item: Item, digit: usize) -> usize {
        let key = (item.ordered() - self.nearest) >> self.shift;
        (key >> (digit as u32 * DIGIT_BITS)) as usize % BUCKETS
    }
}

/// The sort and its memory.
pub(in crate::gpu) struct Sorter {
    scratch: Vec<Item>,
    counts: Box<[[u32; BUCKETS]; DIGITS]>,
}

impl Sorter {
    /// A sort of up to `capacity` items without further allocation.
    pub(in crate::gpu) fn new(capacity: usize) -> Sorter {
        Sorter { scratch: Vec::with_capacity(capacity), counts: Box::new([[0; BUCKETS]; DIGITS]) }
    }

    /// Replaces `order` by the rows of `items` from the farthest to the nearest. Of items at the
    /// same depth, the first of `items` counts as nearest. Leaves `items` in any order.
    pub(in crate::gpu) fn sort(&mut self, items: &mut Vec<Item>, order: &mut Vec<u32>) {
        let key = Key::new(items);
        self.count(items, key);
        self.scratch.resize(items.len(), Item(0));
        for digit in 0..DIGITS {
            let counts = &mut self.counts[digit];
            // All items share the digit: they are in order already.
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
                let place = &mut counts[key.digit(item, digit)];
                self.scratch[*place as usize] = item;
                *place += 1;
            }
            std::mem::swap(items, &mut self.scratch);
        }
        order.clear();
        order.extend(items.iter().rev().map(|item| item.row()));
    }

    /// Counts how often each value of each digit occurs.
    fn count(&mut self, items: &[Item], key: Key) {
        self.counts.iter_mut().for_each(|counts| counts.fill(0));
        for item in items {
            for (digit, counts) in self.counts.iter_mut().enumerate() {
                counts[key.digit(*item, digit)] += 1;
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

    /// Rows by rising depth, ties in their order, then reversed.
    fn expected(depths: &[f32]) -> Vec<u32> {
        let mut rows: Vec<u32> = (0..depths.len() as u32).collect();
        rows.sort_by(|&a, &b| depths[a as usize].total_cmp(&depths[b as usize]));
        rows.reverse();
        rows
    }

    #[test]
    fn farthest_first_and_the_first_of_equals_nearest() {
        assert_eq!(sorted(&[1.0, 3.0, 2.0, 3.0, 1.0]), [3, 1, 2, 4, 0]);
        assert!(sorted(&[]).is_empty());
        assert_eq!(sorted(&[7.0; 4]), [3, 2, 1, 0]);
    }

    #[test]
    fn any_floats() {
        let special = [0.0, 1e-40, -1e30, f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, -2.5];
        assert_eq!(sorted(&special), expected(&special));
    }

    /// 20,000 depths from `near` to `far`.
    fn random(near: f32, far: f32) -> Vec<f32> {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            near + (far - near) * ((state >> 8) as f32 / (1 << 24) as f32)
        };
        (0..20_000).map(|_| random()).collect()
    }

    #[test]
    fn many_items_with_ties() {
        // Few distinct values near 5, so that ties and shared digits occur.
        let depths: Vec<f32> = random(0.0, 4096.0).iter().map(|x| 5.0 + x.floor() * 1e-3).collect();
        assert_eq!(sorted(&depths), expected(&depths));
    }

    #[test]
    fn depths_are_told_apart_to_millionths() {
        for (near, far, bound) in [(1.0, 1.9, 3e-7), (0.5, 3.0, 1e-6), (0.05, 100.0, 4e-6)] {
            let depths = random(near, far);
            let order = sorted(&depths);
            for pair in order.windows(2) {
                let (before, after) = (depths[pair[0] as usize], depths[pair[1] as usize]);
                assert!(before >= after * (1.0 - bound), "{before} {after} between {near} and {far}");
            }
        }
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
