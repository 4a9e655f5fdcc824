//! Models of numbers made of adaptive distributions: [`TokenInteger`] and [`NibbleTree`].

use super::{
    cdf::Cdf,
    start::start,
    token::{Split, bypass_bits, joined, split},
};
use crate::gaussian::{Attribute, CONTEXTS, Integer, Symbols, Tree};

/// Codes symbols with adaptive distributions, and bypass bits.
pub(super) trait TokenSymbols: Symbols {
    /// Codes a symbol below 16 and adapts its distribution.
    fn token(&mut self, cdf: &mut Cdf, symbol: usize) -> usize;

    /// Codes up to 32 bypass bits.
    fn bits(&mut self, count: u32, value: u32) -> u32;
}

/// Codes signed integers: a token, whose distribution depends on the context, and bypass bits.
#[derive(Clone, Debug)]
pub(super) struct TokenInteger {
    /// By context.
    cdfs: [Cdf; CONTEXTS],
}

impl Integer for TokenInteger {
    fn new(attribute: Attribute) -> TokenInteger {
        TokenInteger { cdfs: std::array::from_fn(|context| start(attribute, context)) }
    }

    fn cost(&self, context: usize, value: i32) -> f64 {
        self.cdfs[context].cost(split(value, context).token) + f64::from(bypass_bits(value, context))
    }
}

impl TokenInteger {
    #[inline(always)]
    pub(super) fn code<S: TokenSymbols>(&mut self, symbols: &mut S, context: usize, value: i32) -> i32 {
        let Split { token, mut rest } = if S::ENCODES { split(value, context) } else { Split::default() };
        let token = symbols.token(&mut self.cdfs[context], token);
        joined(token, context, |count| {
            let part = rest & ((1 << count) - 1);
            rest >>= count;
            symbols.bits(count, part as u32)
        })
    }
}

/// Codes unsigned numbers of up to 8 bits: the upper 4 as a symbol, then the others as one whose distribution depends
/// on the upper.
#[derive(Clone, Debug)]
pub(super) struct NibbleTree {
    /// Numbers of bits of both symbols.
    upper_bits: u32,
    lower_bits: u32,
    /// The distribution of the upper symbol, then that of the lower one for each upper one.
    cdfs: Vec<Cdf>,
}

impl Tree for NibbleTree {
    fn new(bits: u32) -> NibbleTree {
        let upper_bits = bits.min(4);
        let lower_bits = bits - upper_bits;
        let lower = if lower_bits == 0 { 0 } else { 1 << upper_bits };
        let mut cdfs = vec![Cdf::uniform(1 << upper_bits)];
        cdfs.resize(1 + lower, Cdf::uniform(1 << lower_bits));
        NibbleTree { upper_bits, lower_bits, cdfs }
    }
}

impl NibbleTree {
    #[inline(always)]
    pub(super) fn code<S: TokenSymbols>(&mut self, symbols: &mut S, value: u32) -> u32 {
        if self.upper_bits == 0 {
            return 0;
        }
        // In a damaged stream a symbol can be one of those that are never coded.
        let mut code = |cdf: &mut Cdf, bits: u32, value: u32| {
            symbols.token(cdf, value as usize) as u32 & ((1 << bits) - 1)
        };
        let upper = code(&mut self.cdfs[0], self.upper_bits, value >> self.lower_bits);
        if self.lower_bits == 0 {
            return upper;
        }
        let lower = value & ((1 << self.lower_bits) - 1);
        upper << self.lower_bits | code(&mut self.cdfs[1 + upper as usize], self.lower_bits, lower)
    }
}
