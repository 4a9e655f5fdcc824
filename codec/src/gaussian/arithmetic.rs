//! [`Arithmetic`]: the functions with which a coder computes numbers from symbols.
//!
//! System functions differ in their last bits between machines, which breaks a coder whose steps
//! depend on decoded numbers. Implementations are IEEE additions, multiplications and divisions in the order
//! written, without fused multiply-add.

/// The arithmetic of a coder. Format: two implementations round differently.
pub(crate) trait Arithmetic {
    /// The integer nearest to `x`.
    fn round(x: f64) -> f64;

    /// `e^x` for `x` cut to `[-700, 700]`.
    fn exp(x: f64) -> f64;

    /// Natural logarithm of a normal positive `x`; others are replaced by the smallest normal one.
    fn ln(x: f64) -> f64;

    /// Sine and cosine of `x` in `[0, pi / 2]`.
    fn sin_cos(x: f64) -> (f64, f64);

    /// `x / unit`.
    fn in_units(x: f64, unit: Unit) -> f64;

    /// Adds the `seen`-th number to a moving average over `window` numbers, a power of two up to 256.
    fn average(mean: &mut f64, number: f64, seen: u32, window: u32);

    /// The context of the magnitude `expected * spread[0] / spread[1]`: half octaves above 2^-4, rounded.
    fn context(expected: f64, spread: [f64; 2]) -> usize;
}

/// A quantisation step or another divisor, with its inverse: several quotients then take one division.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unit {
    pub(crate) size: f64,
    pub(crate) inverse: f64,
}

impl Unit {
    #[inline(always)]
    pub(crate) const fn new(size: f64) -> Unit {
        Unit { size, inverse: 1.0 / size }
    }

    /// The product of two units.
    #[inline(always)]
    pub(crate) fn times(self, factor: Unit) -> Unit {
        Unit { size: self.size * factor.size, inverse: self.inverse * factor.inverse }
    }

    /// The quotient of two units.
    #[inline(always)]
    pub(crate) fn over<A: Arithmetic>(self, divisor: Unit) -> Unit {
        Unit { size: A::in_units(self.size, divisor), inverse: self.inverse * divisor.size }
    }
}

/// `2^(halves / 2)`.
pub(crate) fn half_octaves(halves: u32) -> f64 {
    let octaves = f64::from_bits((1023 + u64::from(halves / 2)) << 52);
    if halves.is_multiple_of(2) { octaves } else { octaves * std::f64::consts::SQRT_2 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_octaves_are_powers() {
        for halves in 0..60 {
            assert!((half_octaves(halves) / 2f64.powf(f64::from(halves) / 2.0) - 1.0).abs() < 4e-16);
        }
    }
}
