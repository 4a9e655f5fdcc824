//! [`Cdf`]: an adaptive distribution of 16 symbols.
//!
//! Its numbers have 16 bits, so that a decoder compares and moves all 16 in two vectors of 128 bits.

use super::math::ln;

/// Binary logarithm of the sum of all frequencies. Format.
pub(super) const SCALE_BITS: u32 = 15;
pub(super) const SCALE: u32 = 1 << SCALE_BITS;

/// Number of symbols.
pub(super) const SYMBOLS: usize = 16;

/// How fast a distribution adapts. Format.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Weight of the start, in symbols, from 3 on.
    pub(super) first: u8,
    /// Largest weight: the last symbols move the distribution by the inverse each.
    pub(super) last: u8,
}

/// `2^16 / n`, rounded down, from 3 on: how far a symbol moves a distribution of weight n. Format.
const PARTS: [i16; 255 + 1] = {
    let mut parts = [0; 255 + 1];
    let mut n = 3;
    while n <= 255 {
        parts[n] = ((1 << 16) / n as i32) as i16;
        n += 1;
    }
    parts
};

/// An adaptive distribution of 16 symbols. Aligned vectors never lie in two cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub(crate) struct Cdf {
    /// Sum of the frequencies below each symbol, then [`SCALE`], which wraps to a negative number. They rise by at
    /// least 1 from symbol to symbol.
    starts: [i16; SYMBOLS + 1],
    /// Symbols seen and the weight of the start, up to a largest weight.
    weight: u8,
    weight_max: u8,
}

/// A symbol and its part of the scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CodedInterval {
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
    pub(super) fn new(starts: [u16; SYMBOLS], pace: Pace) -> Cdf {
        let mut all = [SCALE as u16 as i16; SYMBOLS + 1];
        all.iter_mut().zip(starts).for_each(|(all, start)| *all = start as i16);
        Cdf { starts: all, weight: pace.first, weight_max: pace.last }
    }

    /// A distribution that starts from frequencies in proportion to `shares`, each at least 1.
    pub(super) fn of_shares(shares: [u32; SYMBOLS], pace: Pace) -> Cdf {
        let total = shares.iter().map(|&share| u64::from(share)).sum::<u64>().max(1);
        let mut below = 0;
        let mut starts = [0; SYMBOLS];
        for (i, (start, share)) in starts.iter_mut().zip(shares).enumerate() {
            *start = (below * u64::from(SCALE - SYMBOLS as u32) / total) as u16 + i as u16;
            below += u64::from(share);
        }
        Cdf::new(starts, pace)
    }

    /// The part of a symbol below [`SYMBOLS`].
    #[inline(always)]
    pub(super) fn part(&self, symbol: usize) -> CodedInterval {
        let symbol = symbol % SYMBOLS;
        let start = u32::from(self.starts[symbol] as u16);
        CodedInterval { symbol, start, frequency: u32::from(self.starts[symbol + 1] as u16) - start }
    }

    /// The part in which `slot`, below [`SCALE`], lies.
    #[inline(always)]
    pub(super) fn find(&self, slot: u32) -> CodedInterval {
        let slot = slot as i16;
        let below: u8 = self.starts[..SYMBOLS].iter().map(|&start| u8::from(start <= slot)).sum();
        self.part(usize::from(below.wrapping_sub(1)))
    }

    /// Adapts to a coded symbol.
    #[inline(always)]
    pub(super) fn update(&mut self, symbol: usize) {
        let part = PARTS[usize::from(self.weight)];
        self.weight = self.weight.saturating_add(1).min(self.weight_max);
        // Targets rise by at least 1 from symbol to symbol, and so do starts: so does any mean of both, rounded down.
        for (start, target) in self.starts.iter_mut().zip(&TARGETS[symbol % SYMBOLS]) {
            *start += ((i32::from(target - *start) * i32::from(part)) >> 16) as i16;
        }
    }

    /// Bits that coding `symbol` takes.
    pub(super) fn cost(&self, symbol: usize) -> f64 {
        f64::from(SCALE_BITS) - ln(f64::from(self.part(symbol).frequency)) / std::f64::consts::LN_2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACE: Pace = Pace { first: 4, last: 128 };

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
        for count in 0..=SYMBOLS {
            check(&Cdf::of_shares(std::array::from_fn(|i| u32::from(i < count)), PACE));
            check(&Cdf::of_shares(std::array::from_fn(|i| if i < count { u32::MAX } else { 1 }), PACE));
        }
        let mut state = 1u64;
        for first in 0..SYMBOLS {
            let mut cdf = Cdf::of_shares([1; SYMBOLS], PACE);
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
        let mut cdf = Cdf::of_shares([1; SYMBOLS], PACE);
        (0..1000).for_each(|_| cdf.update(3));
        assert!(cdf.cost(3) < 0.01 && cdf.cost(4) > 7.0, "{cdf:?}");
    }
}
