//! [`Bit`]: an adaptive model of a binary symbol; [`BitSymbols`]: what codes one.

use super::math::{ln, round};
use crate::gaussian::Symbols;

/// Codes bits.
pub(super) trait BitSymbols: Symbols {
    /// Codes a bit with its model, and updates the model.
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool;
}

/// An adaptive bit model: the mean of two probabilities, one adapting fast and one slowly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bit {
    /// Probabilities that the bit is set, in units of 2^-16.
    fast: u16,
    slow: u16,
    /// Bits seen, up to [`SLOW`].
    seen: u8,
}

/// Weight of the initial probability, in bits. Format.
const PRIOR: u32 = 4;

/// Number of bits over which the fast and the slow probability average. Format.
const FAST: u32 = 16;
const SLOW: u32 = 128;

/// Smallest and largest probability, in units of 2^-16. Format.
const PROBABILITY: (f64, f64) = (32.0, 65504.0);

impl Default for Bit {
    fn default() -> Bit {
        Bit::new(0.5)
    }
}

impl Bit {
    /// A model with this initial probability that the bit is set.
    pub(super) fn new(probability: f64) -> Bit {
        let p = round(65536.0 * probability).clamp(PROBABILITY.0, PROBABILITY.1) as u16;
        Bit { fast: p, slow: p, seen: 0 }
    }

    /// Probability that the bit is set, in units of 2^-16: 1 to 65535.
    fn probability(self) -> u32 {
        let mean = (u32::from(self.fast) + u32::from(self.slow)) / 2;
        mean.clamp(PROBABILITY.0 as u32, PROBABILITY.1 as u32)
    }

    /// The part of `range`, at least 2^24, for a set bit: neither zero nor the whole range.
    pub(super) fn split(self, range: u32) -> u32 {
        ((u64::from(range) * u64::from(self.probability())) >> 16) as u32
    }

    /// Adapts to a coded bit.
    pub(super) fn update(&mut self, bit: bool) {
        let seen = u32::from(self.seen) + PRIOR;
        self.seen = (self.seen + 1).min((SLOW - PRIOR) as u8);
        self.fast = toward(self.fast, bit, seen.min(FAST));
        self.slow = toward(self.slow, bit, seen.min(SLOW));
    }

    /// Bits that coding `bit` takes.
    pub(super) fn cost(self, bit: bool) -> f64 {
        let p = f64::from(self.probability()) / 65536.0;
        -ln(if bit { p } else { 1.0 - p }) / std::f64::consts::LN_2
    }
}

/// Moves probability `p` towards `bit` by `1 / divisor` of the distance; `divisor <= SLOW`.
fn toward(p: u16, bit: bool, divisor: u32) -> u16 {
    // The quotient of an integer division. Decoding spends most of its time here, and a division
    // takes several times as long.
    let part = |n: u16| ((u64::from(n) * u64::from(RECIPROCALS[divisor as usize])) >> RECIPROCAL_BITS) as u16;
    if bit { p + part(!p) } else { p - part(p) }
}

/// `2^24 / n`, rounded up. The rounding adds less than `n <= 128`, which does not change the
/// quotient of 16 bits: `65535 * 128 < 2^24`.
const RECIPROCALS: [u32; SLOW as usize + 1] = {
    let mut reciprocals = [0; SLOW as usize + 1];
    let mut n = 1;
    while n <= SLOW {
        reciprocals[n as usize] = (1u32 << RECIPROCAL_BITS).div_ceil(n);
        n += 1;
    }
    reciprocals
};
const RECIPROCAL_BITS: u32 = 24;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reciprocals_divide() {
        for divisor in 1..=SLOW {
            for p in 0..=u16::MAX {
                assert_eq!(toward(p, false, divisor), p - (u32::from(p) / divisor) as u16);
                assert_eq!(toward(p, true, divisor), p + (u32::from(!p) / divisor) as u16);
            }
        }
    }
}
