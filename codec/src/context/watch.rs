//! Where the bits of a chunk go: [`BitObserver`], which a decoder tells, and [`BitStats`], which counts.

#[cfg(feature = "encode")]
use std::collections::HashMap;

/// What numbers are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Part {
    /// Cells of the grid.
    Cells,
    /// Places in them.
    Position,
    /// Classes of visibility and of contrast.
    Classes,
    Opacity,
    Window,
    Scales,
    Rotation,
    Motion,
    Spin,
    Color,
    /// Spherical harmonics from degree 1.
    Harmonics,
}

/// Who is told of the symbols that a decoder reads. `()` does not listen.
pub(crate) trait BitObserver {
    /// The next symbols are for a component of a part.
    fn begin(&mut self, _: Part, _component: usize) {}

    /// A symbol took so many bits.
    fn coded(&mut self, _bits: impl FnOnce() -> f64) {}

    /// The last symbols made a number, so far from its prediction.
    fn number(&mut self, _: i32, _residual: i32) {}

    /// The symbols are one of so many values, none likelier than another.
    fn choice(&mut self, _count: f64) {}
}

impl BitObserver for () {}

/// How often each number came.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
struct Histogram {
    counts: HashMap<i32, u32>,
    total: u32,
}

#[cfg(feature = "encode")]
impl Histogram {
    fn add(&mut self, number: i32) {
        *self.counts.entry(number).or_default() += 1;
        self.total += 1;
    }

    /// Bits of all numbers if each takes what its share of them asks for.
    fn entropy(&self) -> f64 {
        // Sorted, so that the sum does not depend on the order of a hash table.
        let mut counts: Vec<f64> = self.counts.values().map(|&count| f64::from(count)).collect();
        counts.sort_by(f64::total_cmp);
        counts.iter().map(|count| count * (f64::from(self.total) / count).log2()).sum()
    }
}

/// The numbers of a component of a part.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
struct Component {
    codes: Histogram,
    residuals: Histogram,
    /// Bits of choices.
    choices: f64,
    coded: f64,
}

/// Counts bits.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
pub(crate) struct BitStats {
    components: HashMap<(Part, usize), Component>,
    current: Option<(Part, usize)>,
}

/// Bits of a part.
#[cfg(feature = "encode")]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PartBits {
    /// By the frequencies of the numbers; choices at what they are.
    pub(crate) order_0: f64,
    /// By the frequencies of their distances from the predictions; choices at what they are.
    pub(crate) predicted: f64,
    /// As they are coded.
    pub(crate) coded: f64,
}

#[cfg(feature = "encode")]
impl BitStats {
    /// Bits of a part; nothing where it does not occur.
    pub(crate) fn bits(&self, part: Part) -> Option<PartBits> {
        let mut components: Vec<_> = self.components.iter().filter(|(key, _)| key.0 == part).collect();
        components.sort_by_key(|(key, _)| **key);
        components.into_iter().map(|(_, component)| component).fold(None, |sum, component| {
            let PartBits { order_0, predicted, coded } = sum.unwrap_or_default();
            Some(PartBits {
                order_0: order_0 + component.choices + component.codes.entropy(),
                predicted: predicted + component.choices + component.residuals.entropy(),
                coded: coded + component.coded,
            })
        })
    }

    fn component(&mut self) -> &mut Component {
        let current = self.current.expect("a part begins before its symbols");
        self.components.entry(current).or_default()
    }
}

#[cfg(feature = "encode")]
impl BitObserver for &mut BitStats {
    fn begin(&mut self, part: Part, component: usize) {
        self.current = Some((part, component));
    }

    fn coded(&mut self, bits: impl FnOnce() -> f64) {
        self.component().coded += bits();
    }

    fn number(&mut self, code: i32, residual: i32) {
        let component = self.component();
        component.codes.add(code);
        component.residuals.add(residual);
    }

    fn choice(&mut self, count: f64) {
        self.component().choices += count.log2();
    }
}
