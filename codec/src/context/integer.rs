//! Models of numbers made of adaptive bits: [`BitTree`] and [`BitInteger`].

use super::{
    bit::{Bit, BitSymbols},
    math::exp,
};
use crate::gaussian::{Attribute, CONTEXTS, Integer, Prior, Tree, half_octaves};

/// Number of exponents of an integer: magnitudes are below 2^26. Format.
const EXPONENTS: usize = 26;

/// Codes unsigned numbers from the top bit down, each bit with the bits above as context.
#[derive(Clone, Debug)]
pub(super) struct BitTree {
    nodes: Vec<Bit>,
}

impl Tree for BitTree {
    fn new(bits: u32, _: Prior) -> BitTree {
        BitTree { nodes: vec![Bit::default(); 1 << bits] }
    }
}

impl BitTree {
    pub(super) fn code<S: BitSymbols>(&mut self, symbols: &mut S, value: u32) -> u32 {
        let bits = self.nodes.len().ilog2();
        let mut node = 1;
        for bit in (0..bits).rev() {
            let bit = symbols.bit(&mut self.nodes[node], value >> bit & 1 == 1);
            node = node << 1 | usize::from(bit);
        }
        (node - self.nodes.len()) as u32
    }
}

/// Codes signed integers: the bit length of the magnitude in unary, the sign, then the bits below
/// the top one, two of them adaptive and the rest bypass bits. Each context starts from the Laplace distribution of
/// its magnitude and adapts.
#[derive(Clone, Debug)]
pub(super) struct BitInteger {
    /// `[context][exponent]`: whether the magnitude is longer than `exponent` bits.
    longer: Vec<Bit>,
    negative: Bit,
    /// `[exponent][node]`: the two bits below the top one.
    mantissa: Vec<[Bit; 4]>,
}

impl Integer for BitInteger {
    /// Every component has its own.
    fn group(_: Attribute, component: usize) -> usize {
        component
    }

    fn new(_: Attribute) -> BitInteger {
        let longer = |context: usize, exponent: usize| {
            // Expected magnitude of the context.
            let mean = half_octaves(context as u32) / 16.0;
            // Magnitudes of `exponent` bits lie between these bounds, longer ones above.
            let low = if exponent == 0 { 0.0 } else { (1u32 << (exponent - 1)) as f64 - 0.5 };
            let high = (1u32 << exponent) as f64 - 0.5;
            Bit::new(exp((low - high) / mean))
        };
        BitInteger {
            longer: (0..CONTEXTS).flat_map(|c| (0..EXPONENTS).map(move |e| longer(c, e))).collect(),
            negative: Bit::default(),
            mantissa: vec![[Bit::new(0.45); 4]; EXPONENTS + 1],
        }
    }

    fn cost(&self, context: usize, value: i32) -> f64 {
        let magnitude = value.unsigned_abs();
        let length = (32 - magnitude.leading_zeros()) as usize;
        let longer = &self.longer[context * EXPONENTS..(context + 1) * EXPONENTS];
        let mut cost: f64 = longer.iter().take(length).map(|bit| bit.cost(true)).sum();
        cost += longer.get(length).map_or(0.0, |bit| bit.cost(false));
        if length == 0 {
            return cost;
        }
        cost += self.negative.cost(value < 0);
        let (mut node, mut left) = (1, length - 1);
        while left > 0 && node < 4 {
            left -= 1;
            let bit = magnitude >> left & 1 == 1;
            cost += self.mantissa[length][node].cost(bit);
            node = node << 1 | usize::from(bit);
        }
        cost + left as f64
    }
}

impl BitInteger {
    pub(super) fn code<S: BitSymbols>(&mut self, symbols: &mut S, context: usize, value: i32) -> i32 {
        let magnitude = value.unsigned_abs();
        let length = 32 - magnitude.leading_zeros();
        let longer = &mut self.longer[context * EXPONENTS..(context + 1) * EXPONENTS];
        let mut bits = 0;
        while bits < EXPONENTS && symbols.bit(&mut longer[bits], bits < length as usize) {
            bits += 1;
        }
        if bits == 0 {
            return 0;
        }
        let negative = symbols.bit(&mut self.negative, value < 0);
        let mut coded = 1;
        let mut left = bits as u32 - 1;
        while left > 0 && coded < 4 {
            left -= 1;
            let node = &mut self.mantissa[bits][coded as usize];
            coded = coded << 1 | u32::from(symbols.bit(node, magnitude >> left & 1 == 1));
        }
        let rest = symbols.bypass(left, u64::from(magnitude) & ((1 << left) - 1));
        let coded = (coded << left | rest as u32) as i32;
        if negative { -coded } else { coded }
    }
}
