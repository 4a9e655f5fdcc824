//! [`Real`]: the scalar type of a computation.
//!
//! Fits compute in `f32`. Tests compare gradients with finite differences in `f64`, in the same code.

use std::f32::consts::LN_2;
use std::fmt::Debug;
use std::ops::{AddAssign, SubAssign};

use num_traits::float::FloatCore;

/// `f32` or `f64`. Generic code uses the functions of this trait; on a concrete type, the inherent `exp`
/// hides [`Real::exp`].
pub trait Real: FloatCore + AddAssign + SubAssign + Default + Debug + Send + Sync + 'static {
    /// Rounds to this precision.
    fn from_f64(x: f64) -> Self;

    /// Converts to double precision, without loss.
    fn to_double(self) -> f64;

    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;

    /// `e^x` to this precision, bit by bit the same on every machine and for any vector width, which
    /// the system's `exp` is not. 0 for `-inf`, NaN for NaN.
    fn exp(self) -> Self;

    /// `2^x` to this precision for `x` up to 0, in fewer operations than [`Real::exp`]; 2^-126 below -126, and for
    /// NaN.
    fn exp2_of_negative(self) -> Self;
}

/// Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits.
const ROUND: f32 = 12_582_912.0;

impl Real for f32 {
    fn from_f64(x: f64) -> f32 {
        x as f32
    }

    fn to_double(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn sqrt(self) -> f32 {
        f32::sqrt(self)
    }

    /// `exp(x)` = 2^n e^r with |r| <= ln(2) / 2: a polynomial and an exponent, which the compiler
    /// vectorises, unlike a library call.
    #[inline(always)]
    fn exp(self) -> f32 {
        // ln 2 in two parts; the first has few enough digits for an exact product with n.
        const LN2_HIGH: f32 = 0.693_359_4;
        const LN2_LOW: f32 = -2.121_944_4e-4;
        let x = self.clamp(-87.3, 88.0);
        let shifted = x * std::f32::consts::LOG2_E + ROUND;
        let n = shifted - ROUND;
        let r = (x - n * LN2_HIGH) - n * LN2_LOW;
        // Taylor series; the remainder is below 2^-24 for |r| <= 0.347.
        let tail = 1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0)));
        let mantissa = 1.0 + r * (1.0 + r * (0.5 + r * tail));
        // Shifts the bits of n into the exponent. A conversion to an integer would not vectorise,
        // because it saturates NaN.
        let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23));
        if self < -87.3 { 0.0 } else { mantissa * power }
    }

    /// As [`Real::exp`].
    #[inline(always)]
    fn exp2_of_negative(self) -> f32 {
        let x = if self > -126.0 { self } else { -126.0 };
        let shifted = x + ROUND;
        let r = x - (shifted - ROUND);
        // The polynomial of this degree with the least relative error for |r| <= 1/2, which is 9.2e-8.
        let linear = LN_2 - 1.8e-7;
        let tail = 0.055_507_336 + r * (0.009_671_513 + r * 0.001_326_472_7);
        let mantissa = 1.0 + r * (linear + r * (0.240_222_42 + r * tail));
        mantissa * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
    }
}

impl Real for f64 {
    fn from_f64(x: f64) -> f64 {
        x
    }

    fn to_double(self) -> f64 {
        self
    }

    #[inline(always)]
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }

    fn exp(self) -> f64 {
        libm::exp(self)
    }

    fn exp2_of_negative(self) -> f64 {
        libm::exp2(if self > -126.0 { self } else { -126.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::Real;

    #[test]
    fn exp_has_the_precision_of_its_type() {
        let mut worst = 0.0_f64;
        for i in -87_000..=87_900 {
            let x = i as f32 * 1e-3;
            let exact = libm::exp(f64::from(x));
            worst = worst.max((f64::from(Real::exp(x)) / exact - 1.0).abs());
        }
        assert!(worst < 2.5e-7, "{worst:e}");
    }

    #[test]
    fn exp2_has_the_precision_of_its_type() {
        let mut worst = 0.0_f64;
        for i in 0..=125_900 {
            let x = i as f32 * -1e-3;
            let exact = libm::exp2(f64::from(x));
            worst = worst.max((f64::from(x.exp2_of_negative()) / exact - 1.0).abs());
        }
        assert!(worst < 2.5e-7, "{worst:e}");
        assert_eq!(0.0_f32.exp2_of_negative(), 1.0);
        let least = [f32::NEG_INFINITY, -300.0, -126.0, f32::NAN].map(Real::exp2_of_negative);
        assert_eq!(least, [2.0_f32.powi(-126); 4]);
    }

    #[test]
    fn exp_of_extremes() {
        assert_eq!(Real::exp(0.0_f32), 1.0);
        assert_eq!(Real::exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(Real::exp(-88.0_f32), 0.0);
        assert!(Real::exp(f32::INFINITY) > 1e38);
        assert!(Real::exp(f32::NAN).is_nan());
    }
}
