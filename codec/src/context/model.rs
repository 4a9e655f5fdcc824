//! Adaptive models of numbers: [`BitTree`], `Integer` and [`Quantity`].
//!
//! A quantity averages the magnitudes of its last numbers in its own unit, and so expects a magnitude
//! of the next code under any step. That expectation, in half octaves, is the context of the code;
//! each context starts from the Laplace distribution of that magnitude and adapts.

use super::{
    bit::Bit,
    math::{exp, half_octaves, round},
    range::Symbols,
};

/// Contexts of an integer: expected magnitudes of 2^-4, 2^-3.5, ..., 2^15.5. Format.
const CONTEXTS: usize = 40;

/// Number of exponents of an integer: magnitudes are below 2^26. Format.
const EXPONENTS: usize = 26;

/// Largest magnitude of a code and of its prediction, so that the residual fits an integer. Larger
/// numbers are cut. Format.
const CODE_MAX: f64 = ((1u32 << (EXPONENTS - 1)) - 1) as f64;

/// Codes unsigned numbers from the top bit down, each bit with the bits above as context.
#[derive(Clone, Debug)]
pub(super) struct BitTree {
    nodes: Vec<Bit>,
}

impl BitTree {
    /// A tree for numbers of `bits` bits.
    pub(super) fn new(bits: u32) -> BitTree {
        BitTree { nodes: vec![Bit::default(); 1 << bits] }
    }

    pub(super) fn code<S: Symbols>(&mut self, symbols: &mut S, value: u32) -> u32 {
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
/// the top one, two of them adaptive and the rest bypass bits.
#[derive(Clone, Debug)]
struct Integer {
    /// `[context][exponent]`: whether the magnitude is longer than `exponent` bits.
    longer: Vec<Bit>,
    negative: Bit,
    /// `[exponent][node]`: the two bits below the top one.
    mantissa: Vec<[Bit; 4]>,
}

impl Integer {
    fn new() -> Integer {
        let longer = |context: usize, exponent: usize| {
            // Expected magnitude of the context.
            let mean = half_octaves(context as u32) / 16.0;
            // Magnitudes of `exponent` bits lie between these bounds, longer ones above.
            let low = if exponent == 0 { 0.0 } else { (1u32 << (exponent - 1)) as f64 - 0.5 };
            let high = (1u32 << exponent) as f64 - 0.5;
            Bit::new(exp((low - high) / mean))
        };
        Integer {
            longer: (0..CONTEXTS).flat_map(|c| (0..EXPONENTS).map(move |e| longer(c, e))).collect(),
            negative: Bit::default(),
            mantissa: vec![[Bit::new(0.45); 4]; EXPONENTS + 1],
        }
    }

    fn code<S: Symbols>(&mut self, symbols: &mut S, context: usize, value: i32) -> i32 {
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

    /// Bits that coding `value` takes.
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

/// A number that every Gaussian has: its model and the averages of its last values.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    integer: Integer,
    /// Mean distance of the last numbers from their predictions: over few and over many.
    fast: f64,
    slow: f64,
    /// Mean of the last numbers.
    mean: f64,
    seen: f64,
}

/// Numbers over which the means of a [`Quantity`] average. Format.
const FAST_NUMBERS: f64 = 16.0;
const SLOW_NUMBERS: f64 = 256.0;
const MEAN_NUMBERS: f64 = 128.0;

/// Expected distance of the first number from its prediction, in steps. Format.
const FIRST_STEPS: f64 = 16.0;

/// How to code one number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coding {
    /// Unit of the codes.
    pub(super) step: f64,
    /// Predicted number.
    pub(super) prediction: f64,
    /// Factor on the expected distance from the prediction.
    pub(super) spread: f64,
    /// Rate-distortion trade-off: squared error, in steps, that is worth a bit. The decoder ignores
    /// it.
    pub(super) lambda: f64,
}

impl Coding {
    /// Codes a number near `prediction`, rounded to the nearest step.
    pub(super) fn near(step: f64, prediction: f64) -> Coding {
        Coding { step, prediction, spread: 1.0, lambda: 0.0 }
    }
}

impl Quantity {
    pub(super) fn new() -> Quantity {
        Quantity { integer: Integer::new(), fast: 0.0, slow: 0.0, mean: 0.0, seen: 0.0 }
    }

    /// Moving average of the numbers so far.
    pub(super) fn mean(&self) -> f64 {
        self.mean
    }

    /// Expected distance of the next number from its prediction, in steps.
    pub(super) fn expected(&self, step: f64) -> f64 {
        if self.seen == 0.0 { FIRST_STEPS } else { 0.5 * (self.fast + self.slow) / step }
    }

    /// Codes `number` as a multiple of the step, and returns the multiple.
    pub(super) fn code<S: Symbols>(&mut self, symbols: &mut S, number: f64, coding: Coding) -> i32 {
        let Coding { step, prediction, spread, lambda } = coding;
        let context = context_of(self.expected(step) * spread);
        let predicted = round(prediction / step).clamp(-CODE_MAX, CODE_MAX);
        let residual = if S::ENCODES {
            self.quantise((number / step).clamp(-CODE_MAX, CODE_MAX) - predicted, context, lambda)
        } else {
            0
        };
        let residual = self.integer.code(symbols, context, residual);
        let coded = predicted as i32 + residual;
        symbols.number(coded, residual);

        if self.seen == 0.0 {
            (self.fast, self.slow) = (FIRST_STEPS * step, FIRST_STEPS * step);
        }
        self.seen += 1.0;
        let distance = f64::from(residual.unsigned_abs()) * step;
        average(&mut self.fast, distance, self.seen + 2.0, FAST_NUMBERS);
        average(&mut self.slow, distance, self.seen + 2.0, SLOW_NUMBERS);
        average(&mut self.mean, f64::from(coded) * step, self.seen, MEAN_NUMBERS);
        coded
    }

    /// The code of `steps`: the neighbour with the lower sum of squared error and weighted bits.
    fn quantise(&self, steps: f64, context: usize, lambda: f64) -> i32 {
        if lambda == 0.0 {
            return round(steps) as i32;
        }
        let below = steps.floor();
        let cost =
            |code: f64| (steps - code) * (steps - code) + lambda * self.integer.cost(context, code as i32);
        (if cost(below) <= cost(below + 1.0) { below } else { below + 1.0 }) as i32
    }
}

/// Adds the `seen`-th number to a moving average over `window` numbers, a power of two.
fn average(mean: &mut f64, number: f64, seen: f64, window: f64) {
    let difference = number - *mean;
    // Exact for a power of two, and faster than a division.
    *mean += if seen < window { difference / seen } else { difference * (1.0 / window) };
}

/// The context of an expected magnitude: half octaves above 2^-4, rounded to nearest.
fn context_of(expected: f64) -> usize {
    // Half of a half octave, for rounding: the fourth root of 2.
    const QUARTER_OCTAVE: f64 = 1.189_207_115_002_721;
    let bits = (expected * (16.0 * QUARTER_OCTAVE)).clamp(1.0, 1_048_576.0).to_bits();
    let octaves = (bits >> 52) as usize - 1023;
    let upper = bits & 0x000f_ffff_ffff_ffff >= std::f64::consts::SQRT_2.to_bits() & 0x000f_ffff_ffff_ffff;
    (2 * octaves + usize::from(upper)).min(CONTEXTS - 1)
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::context::range::{Decoder, Encoder};

    #[test]
    fn contexts_are_half_octaves() {
        for context in 0..CONTEXTS {
            let mean = half_octaves(context as u32) / 16.0;
            for factor in [0.85, 1.0, 1.18] {
                assert_eq!(context_of(mean * factor), context);
            }
        }
        assert_eq!(context_of(0.0), 0);
        assert_eq!(context_of(f64::INFINITY), CONTEXTS - 1);
        assert!(context_of(f64::NAN) < CONTEXTS);
    }

    #[test]
    fn integers_of_every_size_round_trip() {
        let values: Vec<i32> =
            (0..26).flat_map(|e| [1 << e, -(1 << e), (1 << e) - 1]).chain([0, (1 << 26) - 1]).collect();
        let mut encoder = Encoder::new(Vec::new());
        let mut integer = Integer::new();
        for (i, &value) in values.iter().enumerate() {
            assert_eq!(integer.code(&mut encoder, i % CONTEXTS, value), value);
        }
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&bytes, ());
        let mut integer = Integer::new();
        for (i, &value) in values.iter().enumerate() {
            assert_eq!(integer.code(&mut decoder, i % CONTEXTS, 0), value);
        }
        assert_eq!((decoder.overrun(), decoder.left()), (false, 0));
    }

    #[test]
    fn the_cost_predicts_the_coded_bits() {
        let mut quantity = Quantity::new();
        let mut encoder = Encoder::new(Vec::new());
        let mut cost = 0.0;
        for i in 0..5000i32 {
            let value = (i * 7919) % 23 - 11;
            let context = context_of(quantity.expected(1.0));
            cost += quantity.integer.cost(context, value);
            let coding = Coding { step: 1.0, prediction: 0.0, spread: 1.0, lambda: 0.0 };
            assert_eq!(quantity.code(&mut encoder, f64::from(value), coding), value);
        }
        let bits = 8.0 * encoder.finish().len() as f64;
        assert!((bits - cost).abs() < 0.002 * bits + 40.0, "{bits} bits, {cost} expected");
    }

    #[test]
    fn numbers_beyond_the_codes_are_cut_and_later_ones_exact() {
        let mut quantity = Quantity::new();
        let mut encoder = Encoder::new(Vec::new());
        for number in [1e30, 0.0, -1e30, 3e4, f64::MAX, -3e4, 1.0] {
            let coding = Coding::near(1e-3, 20.0 * quantity.mean());
            let code = quantity.code(&mut encoder, number, coding);
            assert_eq!(f64::from(code), round(number / 1e-3).clamp(-CODE_MAX, CODE_MAX));
        }
    }
}
