//! [`Encoder`]: runs the models forward and records the symbols, then writes them backwards.
//!
//! A rANS decoder takes symbols from a state in the opposite order of the encoder.

use super::{
    cdf::{Cdf, SCALE_BITS},
    decoder::LOW,
    symbols::Symbols,
    uniform::Uniform,
};

/// Records symbols.
#[derive(Default)]
pub(crate) struct Encoder {
    /// Start and frequency of each symbol.
    parts: Vec<(u16, u16)>,
    /// Words of bypass bits.
    words: Vec<u32>,
    /// Bypass bits that do not fill a word yet, the first one lowest, and their number.
    bits: u64,
    bit_count: u32,
}

impl Symbols for Encoder {
    const ENCODES: bool = true;

    fn token(&mut self, cdf: &mut Cdf, symbol: usize) -> usize {
        let part = cdf.part(symbol);
        self.parts.push((part.start as u16, part.frequency as u16));
        cdf.update(symbol);
        symbol
    }

    fn bits(&mut self, count: u32, value: u32) -> u32 {
        self.bits |= u64::from(value) << self.bit_count;
        self.bit_count += count;
        if self.bit_count >= 32 {
            self.words.push(self.bits as u32);
            self.bits >>= 32;
            self.bit_count -= 32;
        }
        value
    }

    fn uniform(&mut self, count: u32, value: u32) -> u32 {
        let uniform = Uniform::new(count);
        let (start, frequency) = uniform.part(value >> uniform.lower_bits);
        self.parts.push((start as u16, frequency as u16));
        self.bits(uniform.lower_bits, value & ((1 << uniform.lower_bits) - 1));
        value
    }
}

impl Encoder {
    /// The bytes of all symbols.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        if self.bit_count > 0 {
            self.words.push(self.bits as u32);
        }
        let mut states = [LOW; 2];
        let mut words = Vec::new();
        for (i, &(start, frequency)) in self.parts.iter().enumerate().rev() {
            let (start, frequency) = (u64::from(start), u64::from(frequency));
            let state = &mut states[i % 2];
            // The decoder takes these bits in after it has taken the symbol away.
            if *state >> (63 - SCALE_BITS) >= frequency {
                words.push(*state as u32);
                *state >>= 32;
            }
            *state = (*state / frequency) << SCALE_BITS | (*state % frequency + start);
        }
        let states = states.into_iter().flat_map(u64::to_le_bytes);
        let words = words.into_iter().rev().chain(self.words.into_iter().rev());
        states.chain(words.flat_map(u32::to_le_bytes)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rans::{cdf::Pace, decoder::Decoder};

    /// Codes the same pseudo-random symbols in either direction.
    fn run(symbols: &mut impl Symbols, seed: u32, count: usize) -> Vec<u64> {
        let mut state = seed;
        let mut next = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        let mut cdfs = [Cdf::of_shares([1; 16], Pace { first: 4, last: 128 }); 4];
        let mut coded = Vec::new();
        for i in 0..count {
            let random = next();
            coded.push(match i % 3 {
                // Distribution 0 sees almost only one symbol.
                0 => symbols.token(
                    &mut cdfs[i % 4],
                    if random % 97 > 30 * (i as u32 % 4) { 5 } else { random as usize % 16 },
                ) as u64,
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
            let count = seed as usize * 7;
            let mut encoder = Encoder::default();
            let coded = run(&mut encoder, seed, count);
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes, ());
            assert_eq!(run(&mut decoder, seed, count), coded);
            assert_eq!((decoder.overrun(), decoder.left(), decoder.is_complete()), (false, 0, true));
        }
    }

    #[test]
    fn a_likely_symbol_costs_little() {
        let mut encoder = Encoder::default();
        let mut cdf = Cdf::of_shares([1; 16], Pace { first: 4, last: 128 });
        for _ in 0..10_000 {
            encoder.token(&mut cdf, 0);
        }
        assert!(encoder.finish().len() < 40);
    }

    #[test]
    fn any_bytes_decode_to_numbers_in_range() {
        for fill in [0x00, 0x55, 0xff] {
            let bytes = [fill; 64];
            let mut decoder = Decoder::new(&bytes, ());
            let mut cdf = Cdf::of_shares([1; 16], Pace { first: 4, last: 128 });
            for count in 1..2000 {
                assert!(decoder.token(&mut cdf, 0) < 16);
                assert!(decoder.uniform(count, 0) < count);
            }
            assert!(decoder.overrun());
        }
    }
}
