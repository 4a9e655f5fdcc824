//! An adaptive binary range coder: [`Decoder`] and `Encoder`.

use super::{
    bit::{Bit, BitSymbols},
    integer::{BitInteger, BitTree},
    math::Math,
    search::LastCells,
};
#[cfg(feature = "encode")]
use crate::gaussian::Writing;
use crate::{
    counters::Work,
    gaussian::{Attribute, BitObserver, Reading, Symbols},
};

/// Smallest range; below it the coder shifts by a byte.
const LOW: u32 = 1 << 24;

/// Codes bypass bits as uniform numbers of up to 16 bits.
fn bypass(symbols: &mut impl Symbols, bits: u32, value: u64) -> u64 {
    let mut coded = 0;
    let mut left = bits;
    while left > 0 {
        let taken = left.min(16);
        left -= taken;
        let part = (value >> left) as u32 & ((1 << taken) - 1);
        coded = coded << taken | u64::from(symbols.uniform(1 << taken, part));
    }
    coded
}

/// Reads symbols. Past the end it reads zeros, which [`Decoder::overrun`] reports.
pub(super) struct Decoder<'a, O = ()> {
    observer: O,
    bytes: &'a [u8],
    /// Number of bytes read, possibly past the end.
    taken: usize,
    range: u32,
    /// Distance of the coded number from the lower end of the range; below `range`.
    code: u32,
}

impl<'a, O: BitObserver> Decoder<'a, O> {
    pub(super) fn new(bytes: &'a [u8], observer: O) -> Decoder<'a, O> {
        let mut decoder = Decoder { observer, bytes, taken: 0, range: u32::MAX, code: 0 };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    fn shift(&mut self) {
        self.code = self.code << 8 | u32::from(self.bytes.get(self.taken).copied().unwrap_or(0));
        self.taken += 1;
    }

    fn normalize(&mut self) {
        while self.range < LOW {
            self.range <<= 8;
            self.shift();
        }
    }
}

impl<O: BitObserver> Reading for Decoder<'_, O> {
    fn overrun(&self) -> bool {
        self.taken > self.bytes.len()
    }

    fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.taken)
    }

    /// A range coder has no final state.
    fn is_complete(&self) -> bool {
        true
    }
}

impl<O: BitObserver> BitSymbols for Decoder<'_, O> {
    fn bit(&mut self, model: &mut Bit, _: bool) -> bool {
        Work::Symbols.count(1);
        let bound = model.split(self.range);
        let bit = self.code < bound;
        if bit {
            self.range = bound;
        } else {
            self.code -= bound;
            self.range -= bound;
        }
        self.observer.coded(|| model.cost(bit));
        model.update(bit);
        self.normalize();
        bit
    }
}

impl<O: BitObserver> Symbols for Decoder<'_, O> {
    const ENCODES: bool = false;

    type Arithmetic = Math;
    type Integer = BitInteger;
    type Tree = BitTree;
    type Search = LastCells;

    fn integer(&mut self, model: &mut BitInteger, context: usize, value: i32) -> i32 {
        model.code(self, context, value)
    }

    fn tree(&mut self, model: &mut BitTree, value: u32) -> u32 {
        model.code(self, value)
    }

    fn bypass(&mut self, bits: u32, value: u64) -> u64 {
        bypass(self, bits, value)
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

    fn uniform(&mut self, count: u32, _: u32) -> u32 {
        Work::Symbols.count(1);
        self.observer.coded(|| f64::from(count).log2());
        let unit = self.range / count;
        // In a damaged stream the number can lie above the last unit.
        let value = (self.code / unit).min(count - 1);
        self.code -= unit * value;
        self.range = unit;
        self.code = self.code.min(unit - 1);
        self.normalize();
        value
    }
}

/// Writes symbols.
#[cfg(feature = "encode")]
pub(super) struct Encoder {
    bytes: Vec<u8>,
    low: u64,
    range: u32,
    /// The last byte, not yet written because a carry can reach it; `None` at the start.
    pending: Option<u8>,
    /// Number of bytes of 255 after it, through which a carry would propagate.
    run: usize,
}

#[cfg(feature = "encode")]
impl Default for Encoder {
    fn default() -> Encoder {
        Encoder { bytes: Vec::new(), low: 0, range: u32::MAX, pending: None, run: 0 }
    }
}

#[cfg(feature = "encode")]
impl Encoder {
    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        let top = (self.low >> 24) as u8;
        if carry == 0 && top == 0xff {
            self.run += 1;
        } else {
            if let Some(pending) = self.pending {
                self.bytes.push(pending.wrapping_add(carry));
            }
            let run = std::mem::take(&mut self.run);
            self.bytes.extend(std::iter::repeat_n(0xffu8.wrapping_add(carry), run));
            self.pending = Some(top);
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    fn normalize(&mut self) {
        while self.range < LOW {
            self.range <<= 8;
            self.shift();
        }
    }
}

#[cfg(feature = "encode")]
impl Writing for Encoder {
    /// Writes the pending bytes, so that there are as many as a decoder reads.
    fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        self.bytes
    }
}

#[cfg(feature = "encode")]
impl Symbols for Encoder {
    const ENCODES: bool = true;

    type Arithmetic = Math;
    type Integer = BitInteger;
    type Tree = BitTree;
    type Search = LastCells;

    fn integer(&mut self, model: &mut BitInteger, context: usize, value: i32) -> i32 {
        model.code(self, context, value)
    }

    fn tree(&mut self, model: &mut BitTree, value: u32) -> u32 {
        model.code(self, value)
    }

    fn bypass(&mut self, bits: u32, value: u64) -> u64 {
        bypass(self, bits, value)
    }

    fn uniform(&mut self, count: u32, value: u32) -> u32 {
        let unit = self.range / count;
        self.low += u64::from(unit) * u64::from(value);
        self.range = unit;
        self.normalize();
        value
    }
}

#[cfg(feature = "encode")]
impl BitSymbols for Encoder {
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool {
        let bound = model.split(self.range);
        if bit {
            self.range = bound;
        } else {
            self.low += u64::from(bound);
            self.range -= bound;
        }
        model.update(bit);
        self.normalize();
        bit
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::gaussian::{CONTEXTS, Integer};

    /// Codes the same pseudo-random symbols in either direction.
    fn run<S: BitSymbols>(symbols: &mut S, seed: u32, count: usize) -> Vec<u64> {
        let mut state = seed;
        let mut next = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        let mut models = [Bit::default(); 4];
        let mut coded = Vec::new();
        for i in 0..count {
            let random = next();
            coded.push(match i % 3 {
                // Model 0 sees almost only set bits, which makes long runs of carries.
                0 => u64::from(symbols.bit(&mut models[i % 4], random % 97 > (i as u32 % 4) * 30)),
                1 => {
                    let choices = 1 + next() % 65536;
                    u64::from(symbols.uniform(choices, random % choices))
                }
                _ => symbols.bypass(random % 49, u64::from(next()) << 20 & ((1 << (random % 49)) - 1)),
            });
        }
        coded
    }

    #[test]
    fn symbols_round_trip_and_use_every_byte() {
        for seed in 0..200 {
            let count = 1 + seed as usize * 7;
            let mut encoder = Encoder::default();
            let coded = run(&mut encoder, seed, count);
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes, ());
            assert_eq!(run(&mut decoder, seed, count), coded);
            assert!(!decoder.overrun());
            assert_eq!(decoder.left(), 0);
        }
    }

    #[test]
    fn a_likely_bit_costs_little() {
        let mut encoder = Encoder::default();
        let mut model = Bit::default();
        for _ in 0..10_000 {
            encoder.bit(&mut model, true);
        }
        assert!(encoder.finish().len() < 40);
    }

    #[test]
    fn any_bytes_decode_to_numbers_in_range() {
        for fill in [0x00, 0x55, 0xff] {
            let bytes = [fill; 16];
            let mut decoder = Decoder::new(&bytes, ());
            let mut model = Bit::default();
            for count in 1..2000 {
                decoder.bit(&mut model, false);
                assert!(decoder.uniform(count, 0) < count);
            }
            assert!(decoder.overrun());
        }
    }

    #[test]
    fn integers_of_every_size_round_trip() {
        let values: Vec<i32> =
            (0..26).flat_map(|e| [1 << e, -(1 << e), (1 << e) - 1]).chain([0, (1 << 26) - 1]).collect();
        let mut encoder = Encoder::default();
        let mut integer = BitInteger::new(Attribute::Color);
        for (i, &value) in values.iter().enumerate() {
            assert_eq!(integer.code(&mut encoder, i % CONTEXTS, value), value);
        }
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&bytes, ());
        let mut integer = BitInteger::new(Attribute::Color);
        for (i, &value) in values.iter().enumerate() {
            assert_eq!(integer.code(&mut decoder, i % CONTEXTS, 0), value);
        }
        assert_eq!((decoder.overrun(), decoder.left()), (false, 0));
    }

    #[test]
    fn the_cost_predicts_the_coded_bits() {
        let mut integer = BitInteger::new(Attribute::Color);
        let mut encoder = Encoder::default();
        let mut cost = 0.0;
        for i in 0..5000i32 {
            let value = (i * 7919) % 23 - 11;
            cost += integer.cost(12, value);
            integer.code(&mut encoder, 12, value);
        }
        let bits = 8.0 * encoder.finish().len() as f64;
        assert!((bits - cost).abs() < 0.002 * bits + 40.0, "{bits} bits, {cost} expected");
    }
}
