//! [`Quantity`]: a number that every Gaussian has, and the expectation of its next value.
//!
//! A quantity averages the magnitudes of its last numbers in its own unit, and so expects a magnitude
//! of the next code under any step. That expectation, in half octaves, is the context of the code.

use crate::rans::{
    Symbols, TokenInteger,
    math::{self, Unit},
};

/// Largest magnitude of a code and of its prediction, so that the residual fits an integer. Larger
/// numbers are cut. Format.
const CODE_MAX: f64 = ((1u32 << 25) - 1) as f64;

/// A number that every Gaussian has: the averages of its last values.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    /// Number of its model.
    model: usize,
    /// Mean distance of the last numbers from their predictions: over few and over many.
    fast: f64,
    slow: f64,
    /// Mean of the last numbers.
    mean: f64,
    seen: u32,
}

/// Numbers over which the means of a [`Quantity`] average. Format.
const FAST_NUMBERS: u32 = 16;
const SLOW_NUMBERS: u32 = 256;
const MEAN_NUMBERS: u32 = 128;

/// Expected distance of the first number from its prediction, in steps. Format.
const FIRST_STEPS: f64 = 16.0;

/// How to code one number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coding {
    pub(super) unit: Unit,
    /// Predicted number.
    pub(super) prediction: f64,
    /// Factor on the expected distance from the prediction, as a fraction.
    pub(super) spread: [f64; 2],
    /// Rate-distortion trade-off: squared error, in steps, that is worth a bit. The decoder ignores
    /// it.
    pub(super) lambda: f64,
}

impl Coding {
    /// Codes a number near `prediction`, rounded to the nearest step.
    pub(super) fn near(unit: Unit, prediction: f64) -> Coding {
        Coding { unit, prediction, spread: [1.0; 2], lambda: 0.0 }
    }
}

impl Quantity {
    /// A quantity whose numbers are coded with this model of those given to [`Quantity::code`].
    pub(super) fn new(model: usize) -> Quantity {
        Quantity { model, fast: 0.0, slow: 0.0, mean: 0.0, seen: 0 }
    }

    /// Moving average of the numbers so far.
    pub(super) fn mean(&self) -> f64 {
        self.mean
    }

    /// Expected distance of the next number from its prediction, in steps.
    #[inline(always)]
    pub(super) fn expected(&self, unit: Unit) -> f64 {
        if self.seen == 0 { FIRST_STEPS } else { math::in_units(0.5 * (self.fast + self.slow), unit) }
    }

    /// Codes `number` as a multiple of the step, and returns the multiple.
    #[inline(always)]
    pub(super) fn code<S: Symbols>(
        &mut self,
        symbols: &mut S,
        models: &mut [TokenInteger],
        number: f64,
        coding: Coding,
    ) -> i32 {
        let model = &mut models[self.model];
        let Coding { unit, prediction, spread, lambda } = coding;
        let context = math::context(self.expected(unit), spread);
        let predicted = math::round(math::in_units(prediction, unit));
        let predicted = predicted.clamp(-CODE_MAX, CODE_MAX);
        let residual = if S::ENCODES {
            let steps = (number / unit.size).clamp(-CODE_MAX, CODE_MAX) - predicted;
            quantise(model, steps, context, lambda)
        } else {
            0
        };
        let residual = model.code(symbols, context, residual);
        let coded = predicted as i32 + residual;
        symbols.number(coded, residual);

        if self.seen == 0 {
            (self.fast, self.slow) = (FIRST_STEPS * unit.size, FIRST_STEPS * unit.size);
        }
        self.seen += 1;
        let distance = f64::from(residual.unsigned_abs()) * unit.size;
        math::average(&mut self.fast, distance, self.seen + 2, FAST_NUMBERS);
        math::average(&mut self.slow, distance, self.seen + 2, SLOW_NUMBERS);
        math::average(&mut self.mean, f64::from(coded) * unit.size, self.seen, MEAN_NUMBERS);
        coded
    }
}

/// The code of `steps`: the neighbour with the lower sum of squared error and weighted bits.
fn quantise(model: &TokenInteger, steps: f64, context: usize, lambda: f64) -> i32 {
    if lambda == 0.0 {
        return math::round(steps) as i32;
    }
    let below = steps.floor();
    let cost = |code: f64| (steps - code) * (steps - code) + lambda * model.cost(context, code as i32);
    (if cost(below) <= cost(below + 1.0) { below } else { below + 1.0 }) as i32
}
