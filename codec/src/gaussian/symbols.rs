//! [`Symbols`]: how a coder codes integers, in both directions.
//!
//! The code for a Gaussian is written once, against the trait. Every method takes the symbol to code
//! and returns the coded symbol: the encoder returns its argument, the decoder ignores it and returns
//! the symbol it reads. So the two directions cannot drift apart.

use super::{arithmetic::Arithmetic, neighbors::Search, observer::Attribute};

/// Codes symbols, to bytes or from bytes.
pub(crate) trait Symbols {
    /// Whether the arguments are coded (encoder) or ignored (decoder).
    const ENCODES: bool;

    type Arithmetic: Arithmetic;
    type Integer: Integer;
    type Tree: Tree;
    type Search: Search;

    /// Codes a signed number of magnitude below 2^26 in a context, and adapts the model.
    fn integer(&mut self, model: &mut Self::Integer, context: usize, value: i32) -> i32;

    /// Codes an unsigned number, and adapts the model.
    fn tree(&mut self, model: &mut Self::Tree, value: u32) -> u32;

    /// Codes one of `count` equally likely numbers, `1 <= count <= 65536`.
    fn uniform(&mut self, count: u32, value: u32) -> u32;

    /// Codes `bits` bypass bits, at most 48: equally likely, without a model.
    fn bypass(&mut self, bits: u32, value: u64) -> u64;

    /// See [`BitObserver::begin`](super::BitObserver::begin).
    fn begin(&mut self, _: Attribute, _component: usize) {}

    /// See [`BitObserver::number`](super::BitObserver::number).
    fn number(&mut self, _: i32, _residual: i32) {}

    /// See [`BitObserver::choice`](super::BitObserver::choice).
    fn choice(&mut self, _count: f64) {}
}

/// An encoder.
#[cfg(feature = "encode")]
pub(crate) trait Writing: Symbols + Default {
    /// The bytes of all symbols.
    fn finish(self) -> Vec<u8>;
}

/// An adaptive model of signed integers in [`CONTEXTS`](super::CONTEXTS) contexts, each for one expected
/// magnitude.
pub(crate) trait Integer {
    /// Number of the model of a component among those of its attribute: components may share models.
    fn group(attribute: Attribute, component: usize) -> usize;

    /// The initial model of an attribute.
    fn new(attribute: Attribute) -> Self;

    /// Bits that coding `value` takes.
    fn cost(&self, context: usize, value: i32) -> f64;
}

/// An adaptive model of numbers of a few bits.
pub(crate) trait Tree: Clone {
    /// The initial model of numbers of `bits` bits, at most 8.
    fn new(bits: u32, prior: Prior) -> Self;
}

/// What is known of a number before the first one is coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Prior {
    Nothing,
    /// It is near another number.
    Near(u32),
    /// It is at most another number.
    AtMost(u32),
    /// Its bits are those of two coordinates in turn, and the middle of the square is likely.
    NearCenterOfSquare,
}
