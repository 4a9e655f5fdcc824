//! [`Real`]: the precision of a computation.
//!
//! What is fitted is fitted in `f32`; gradients are held to finite differences in `f64`, by the same
//! code.

use std::fmt::Debug;
use std::ops::{AddAssign, SubAssign};

/// `f32` or `f64`.
pub trait Real: num_traits::Float + AddAssign + SubAssign + Default + Debug + Send + Sync + 'static {
    /// The nearest number of this precision.
    fn of(x: f64) -> Self;

    /// The number in double precision.
    fn to_double(self) -> f64;

    /// `e^x` to this precision, the same on every machine and for every width of its vectors;
    /// the system's is neither. 0 for `-inf`, NaN for NaN.
    fn exponential(self) -> Self;
}

/// `exp(x)` = 2^n e^r with |r| <= ln(2) / 2: a polynomial and an exponent, which compilers turn into
/// vectors; a call into a library they do not.
impl Real for f32 {
    fn of(x: f64) -> f32 {
        x as f32
    }

    fn to_double(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn exponential(self) -> f32 {
        // Adding 1.5 * 2^23 rounds to the nearest integer, which then stands in the low bits.
        const ROUND: f32 = 12_582_912.0;
        // ln 2 in two parts: the first has so few digits that its product with n is exact.
        const LN2_HIGH: f32 = 0.693_359_4;
        const LN2_LOW: f32 = -2.121_944_4e-4;
        let x = self.clamp(-87.3, 88.0);
        let shifted = x * std::f32::consts::LOG2_E + ROUND;
        let n = shifted - ROUND;
        let r = (x - n * LN2_HIGH) - n * LN2_LOW;
        // Taylor's series: the term left out is below 2^-24 for |r| <= 0.347.
        let tail = 1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0)));
        let mantissa = 1.0 + r * (1.0 + r * (0.5 + r * tail));
        // The bits of n, moved to where the exponent stands. A conversion to integers would not become
        // vectors, for what it does with NaN.
        let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23));
        if self < -87.3 { 0.0 } else { mantissa * power }
    }
}

impl Real for f64 {
    fn of(x: f64) -> f64 {
        x
    }

    fn to_double(self) -> f64 {
        self
    }

    fn exponential(self) -> f64 {
        libm::exp(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_has_the_precision_of_its_type() {
        let mut worst = 0.0_f64;
        for i in -87_000..=87_900 {
            let x = i as f32 * 1e-3;
            let exact = libm::exp(f64::from(x));
            worst = worst.max((f64::from(x.exponential()) / exact - 1.0).abs());
        }
        assert!(worst < 2.5e-7, "{worst:e}");
    }

    #[test]
    fn the_exponential_ends_well() {
        assert_eq!(0.0_f32.exponential(), 1.0);
        assert_eq!(f32::NEG_INFINITY.exponential(), 0.0);
        assert_eq!((-88.0_f32).exponential(), 0.0);
        assert!(f32::INFINITY.exponential() > 1e38);
        assert!(f32::NAN.exponential().is_nan());
    }
}
