//! [`Decoder`]: reads symbols from two interleaved rANS states, and bypass bits from the other end of the bytes.
//!
//! A state holds the symbols to come in a number of 31 to 63 bits. Taking one away divides the state by the inverse of
//! the symbol's probability; a state below 2^31 takes in 32 bits. Symbols come from both states in turn, so that a
//! processor works on two at a time.

use super::{
    cdf::{Cdf, SCALE, SCALE_BITS},
    observer::{Attribute, BitObserver},
    symbols::Symbols,
    uniform::Uniform,
};
use crate::counters::Work;

/// Smallest state, and the final one. Format.
pub(super) const LOW: u64 = 1 << 31;

/// Reads symbols. Past the end it reads zeros, which [`Decoder::overrun`] reports.
pub(crate) struct Decoder<'a, O = ()> {
    observer: O,
    /// Bytes not read: states take words from the front, bypass bits from the back.
    bytes: &'a [u8],
    overrun: bool,
    /// The state of the next symbol, and the other.
    states: [u64; 2],
    /// Bypass bits, the next one lowest, and their number.
    bits: u64,
    bit_count: u32,
}

impl<'a, O: BitObserver> Decoder<'a, O> {
    pub(crate) fn new(bytes: &'a [u8], observer: O) -> Decoder<'a, O> {
        let mut decoder = Decoder { observer, bytes, overrun: false, states: [0; 2], bits: 0, bit_count: 0 };
        decoder.states = [0; 2].map(|_| decoder.word() | decoder.word() << 32);
        decoder
    }

    /// The next word for a state.
    #[inline(always)]
    fn word(&mut self) -> u64 {
        let Some((word, rest)) = self.bytes.split_first_chunk() else {
            self.overrun = true;
            return 0;
        };
        self.bytes = rest;
        u64::from(u32::from_le_bytes(*word))
    }

    /// Takes the part of a symbol away from a state.
    #[inline(always)]
    fn advance(&mut self, start: u32, frequency: u32) {
        let [state, other] = self.states;
        let slot = state & u64::from(SCALE - 1);
        let mut state = u64::from(frequency) * (state >> SCALE_BITS) + (slot - u64::from(start));
        if state < LOW {
            state = state << 32 | self.word();
        }
        self.states = [other, state];
    }

    #[inline(always)]
    fn slot(&self) -> u32 {
        self.states[0] as u32 & (SCALE - 1)
    }

    /// Whether it has read past the end.
    pub(crate) fn overrun(&self) -> bool {
        self.overrun
    }

    /// Number of bytes not read.
    pub(crate) fn left(&self) -> usize {
        self.bytes.len()
    }

    /// Whether its final state is the state of an encoder before the first symbol.
    pub(crate) fn is_complete(&self) -> bool {
        self.states == [LOW; 2] && self.bits == 0
    }
}

impl<O: BitObserver> Symbols for Decoder<'_, O> {
    const ENCODES: bool = false;

    #[inline(always)]
    fn token(&mut self, cdf: &mut Cdf, _: usize) -> usize {
        Work::Symbols.count(1);
        let part = cdf.find(self.slot());
        self.observer.coded(|| cdf.cost(part.symbol));
        self.advance(part.start, part.frequency);
        cdf.update(part.symbol);
        part.symbol
    }

    #[inline(always)]
    fn bits(&mut self, count: u32, _: u32) -> u32 {
        Work::Symbols.count(1);
        self.observer.coded(|| f64::from(count));
        if self.bit_count < count {
            let word = match self.bytes.split_last_chunk() {
                Some((rest, word)) => {
                    self.bytes = rest;
                    u32::from_le_bytes(*word)
                }
                None => {
                    self.overrun = true;
                    0
                }
            };
            self.bits |= u64::from(word) << self.bit_count;
            self.bit_count += 32;
        }
        let value = self.bits & ((1 << count) - 1);
        self.bits >>= count;
        self.bit_count -= count;
        value as u32
    }

    #[inline(always)]
    fn uniform(&mut self, count: u32, _: u32) -> u32 {
        Work::Symbols.count(1);
        let uniform = Uniform::new(count);
        let upper = uniform.find(self.slot());
        let (start, frequency) = uniform.part(upper);
        self.observer.coded(|| (f64::from(SCALE) / f64::from(frequency)).log2());
        self.advance(start, frequency);
        let lower = self.bits(uniform.lower_bits, 0);
        // In a damaged stream the number can lie above the last one.
        (upper << uniform.lower_bits | lower).min(count - 1)
    }

    fn begin(&mut self, attribute: Attribute, component: usize) {
        self.observer.begin(attribute, component);
    }

    fn number(&mut self, code: i32, residual: i32) {
        self.observer.number(code, residual);
    }

    fn choice(&mut self, count: f64) {
        self.observer.choice(count);
    }
}
