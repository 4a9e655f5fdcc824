//! [`Symbols`]: codes symbols, in both directions.
//!
//! The code for a Gaussian is written once, against the trait. Every method takes the symbol to code
//! and returns the coded symbol: the encoder returns its argument, the decoder ignores it and returns
//! the symbol it reads. So the two directions cannot drift apart.

use super::{cdf::Cdf, observer::Attribute};

/// Codes symbols, to bytes or from bytes.
pub(crate) trait Symbols {
    /// Whether the arguments are coded (encoder) or ignored (decoder).
    const ENCODES: bool;

    /// Codes a symbol below 16 and adapts its distribution.
    fn token(&mut self, cdf: &mut Cdf, symbol: usize) -> usize;

    /// Codes up to 32 bypass bits: equally likely, without a model.
    fn bits(&mut self, count: u32, value: u32) -> u32;

    /// Codes one of `count` equally likely numbers, `1 <= count <= 65536`.
    fn uniform(&mut self, count: u32, value: u32) -> u32;

    /// Codes `bits` bypass bits, at most 48.
    fn bypass(&mut self, bits: u32, value: u64) -> u64 {
        let lower = u64::from(self.bits(bits.min(32), value as u32));
        lower | u64::from(self.bits(bits.saturating_sub(32), (value >> 32) as u32)) << 32
    }

    /// See [`BitObserver::begin`](super::BitObserver::begin).
    fn begin(&mut self, _: Attribute, _component: usize) {}

    /// See [`BitObserver::number`](super::BitObserver::number).
    fn number(&mut self, _: i32, _residual: i32) {}

    /// See [`BitObserver::choice`](super::BitObserver::choice).
    fn choice(&mut self, _count: f64) {}
}
