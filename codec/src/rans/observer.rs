//! The bits that each attribute of a chunk takes: [`BitObserver`] sees the symbols of a decoder,
//! `BitStats` counts them.

#[cfg(feature = "encode")]
use std::collections::HashMap;

/// Attributes, in the order in which they are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Attribute {
    /// Cells of the grid.
    Cells,
    /// Positions within the cells.
    Position,
    /// Quantiser indices of visibility and geometry.
    QuantiserIndices,
    Opacity,
    WindowWidth,
    WindowCenter,
    Scales,
    Rotation,
    Motion,
    AngularRate,
    Color,
    /// Spherical harmonics from degree 1.
    Harmonics,
}

/// Sees the symbols that a decoder reads. `()` ignores them.
pub(crate) trait BitObserver {
    /// The next symbols belong to a component of an attribute.
    fn begin(&mut self, _: Attribute, _component: usize) {}

    /// A symbol took this many bits.
    fn coded(&mut self, _bits: impl FnOnce() -> f64) {}

    /// The last symbols made a number with this residual from its prediction.
    fn number(&mut self, _: i32, _residual: i32) {}

    /// The next symbols choose one of `count` equally likely values.
    fn choice(&mut self, _count: f64) {}
}

impl BitObserver for () {}

/// Frequencies of numbers.
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

    /// Order-0 entropy of all numbers in bits.
    fn entropy(&self) -> f64 {
        // Sorted, so that the sum does not depend on the order of the hash table.
        let mut counts: Vec<f64> = self.counts.values().map(|&count| f64::from(count)).collect();
        counts.sort_by(f64::total_cmp);
        counts.iter().map(|count| count * (f64::from(self.total) / count).log2()).sum()
    }
}

/// The numbers of a component of an attribute.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
struct Component {
    codes: Histogram,
    residuals: Histogram,
    /// Bits of choices among equally likely values.
    choices: f64,
    coded: f64,
}

/// Counts the bits of each attribute.
#[cfg(feature = "encode")]
#[derive(Debug, Default)]
pub(crate) struct BitStats {
    components: HashMap<(Attribute, usize), Component>,
    current: Option<(Attribute, usize)>,
}

/// Bits of an attribute under three codings. Choices among equally likely values take the same in
/// the first two.
#[cfg(feature = "encode")]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct AttributeBits {
    /// Order-0 entropy of the numbers.
    pub(crate) order_0: f64,
    /// Order-0 entropy of the residuals.
    pub(crate) predicted: f64,
    /// As coded.
    pub(crate) coded: f64,
}

#[cfg(feature = "encode")]
impl BitStats {
    /// Bits of an attribute; `None` if it does not occur.
    pub(crate) fn bits(&self, attribute: Attribute) -> Option<AttributeBits> {
        let mut components: Vec<_> = self.components.iter().filter(|(key, _)| key.0 == attribute).collect();
        components.sort_by_key(|(key, _)| **key);
        components.into_iter().map(|(_, component)| component).fold(None, |sum, component| {
            let AttributeBits { order_0, predicted, coded } = sum.unwrap_or_default();
            Some(AttributeBits {
                order_0: order_0 + component.choices + component.codes.entropy(),
                predicted: predicted + component.choices + component.residuals.entropy(),
                coded: coded + component.coded,
            })
        })
    }

    fn component(&mut self) -> &mut Component {
        let current = self.current.expect("begin precedes the symbols");
        self.components.entry(current).or_default()
    }
}

#[cfg(feature = "encode")]
impl BitObserver for &mut BitStats {
    fn begin(&mut self, attribute: Attribute, component: usize) {
        self.current = Some((attribute, component));
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
