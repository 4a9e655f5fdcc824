//! [`Cdf`]: an adaptive distribution of 16 symbols.
//!
//! Its numbers have 16 bits, so that a decoder compares and moves all 16 in two vectors of 128 bits.

use super::math::Math;
use crate::gaussian::Arithmetic;

/// Binary logarithm of the sum of all frequencies. Format.
pub(super) const SCALE_BITS: u32 = 15;
pub(super) const SCALE: u32 = 1 << SCALE_BITS;

/// Number of symbols.
pub(super) const SYMBOLS: usize = 16;

/// Weights with which distributions start, in symbols: one that is known roughly, and one that is not. Format.
pub(super) const KNOWN: u8 = 32;
pub(super) const UNKNOWN: u8 = 4;

/// Largest weight: the last symbols move a distribution by 1/128 each. Format.
const WEIGHT_MAX: u8 = 128;

/// An adaptive distribution of 16 symbols.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cdf {
    /// Sum of the frequencies below each symbol, then [`SCALE`], which wraps to a negative number. They rise by at
    /// least 1 from symbol to symbol.
    starts: [i16; SYMBOLS + 1],
    /// Symbols seen and the weight of the start, up to [`WEIGHT_MAX`].
    weight: u8,
}

/// A symbol and its part of the scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) symbol: usize,
    pub(super) start: u32,
    pub(super) frequency: u32,
}

/// `[symbol]`: the distribution towards which it moves a CDF: frequency 1 for all others.
const TARGETS: [[i16; SYMBOLS]; SYMBOLS] = {
    let mut targets = [[0; SYMBOLS]; SYMBOLS];
    let mut symbol = 0;
    while symbol < SYMBOLS {
        let mut i = 0;
        while i < SYMBOLS {
            let rest = if i > symbol { SCALE as i16 as i32 - SYMBOLS as i32 } else { 0 };
            targets[symbol][i] = (rest + i as i32) as i16;
            i += 1;
        }
        symbol += 1;
    }
    targets
};

impl Cdf {
    /// A distribution that starts from these sums of frequencies.
    pub(super) fn new(starts: [u16; SYMBOLS], weight: u8) -> Cdf {
        let mut all = [SCALE as u16 as i16; SYMBOLS + 1];
        all.iter_mut().zip(starts).for_each(|(all, start)| *all = start as i16);
        Cdf { starts: all, weight }
    }

    /// A distribution of `count` equally likely symbols; the others have frequency 1.
    pub(super) fn uniform(count: usize) -> Cdf {
        let unused = SYMBOLS - count;
        let starts = std::array::from_fn(|i| match i < count {
            true => i * (SCALE as usize - unused) / count,
            false => SCALE as usize - SYMBOLS + i,
        });
        Cdf::new(starts.map(|start| start as u16), UNKNOWN)
    }

    /// The part of a symbol below [`SYMBOLS`].
    #[inline(always)]
    pub(super) fn part(&self, symbol: usize) -> Part {
        let symbol = symbol % SYMBOLS;
        let start = u32::from(self.starts[symbol] as u16);
        Part { symbol, start, frequency: u32::from(self.starts[symbol + 1] as u16) - start }
    }

    /// The part in which `slot`, below [`SCALE`], lies.
    #[inline(always)]
    pub(super) fn find(&self, slot: u32) -> Part {
        let slot = slot as i16;
        let below: u8 = self.starts[..SYMBOLS].iter().map(|&start| u8::from(start <= slot)).sum();
        self.part(usize::from(below.wrapping_sub(1)))
    }

    /// Adapts to a coded symbol.
    #[inline(always)]
    pub(super) fn update(&mut self, symbol: usize) {
        let rate = self.weight.ilog2() as i16;
        self.weight = (self.weight + 1).min(WEIGHT_MAX);
        // Targets rise by at least 1 from symbol to symbol, and so do starts: so does any mean of both, rounded down.
        for (start, target) in self.starts.iter_mut().zip(&TARGETS[symbol % SYMBOLS]) {
            *start += (target - *start) >> rate;
        }
    }

    /// Bits that coding `symbol` takes.
    pub(super) fn cost(&self, symbol: usize) -> f64 {
        f64::from(SCALE_BITS) - Math::ln(f64::from(self.part(symbol).frequency)) / std::f64::consts::LN_2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(cdf: &Cdf) {
        let mut end = 0;
        for symbol in 0..SYMBOLS {
            let part = cdf.part(symbol);
            assert_eq!((part.symbol, part.start), (symbol, end));
            assert!((1..=SCALE).contains(&part.frequency), "{cdf:?}");
            end += part.frequency;
            assert_eq!([part.start, end - 1].map(|slot| cdf.find(slot)), [part; 2]);
        }
        assert_eq!(end, SCALE);
    }

    /// Long runs of one symbol, then of another, are the hardest.
    #[test]
    fn every_frequency_is_at_least_1() {
        for count in 1..=SYMBOLS {
            check(&Cdf::uniform(count));
        }
        let mut state = 1u64;
        for first in 0..SYMBOLS {
            let mut cdf = Cdf::uniform(SYMBOLS);
            for i in 0..20_000u64 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let random = (state >> 33) as usize;
                cdf.update(if i % 4000 < 3000 { first } else { random % SYMBOLS });
                check(&cdf);
            }
        }
    }

    #[test]
    fn a_distribution_approaches_that_of_its_symbols() {
        let mut cdf = Cdf::uniform(SYMBOLS);
        (0..1000).for_each(|_| cdf.update(3));
        assert!(cdf.cost(3) < 0.01 && cdf.cost(4) > 7.0, "{cdf:?}");
    }
}
