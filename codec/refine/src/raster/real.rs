//! [`Real`]: the scalar type of a computation.
//!
//! Fits compute in `f32`. The reference, and tests that compare gradients with finite differences, compute in `f64`, in the
//! same code.
//!
//! Pictures decide the content of packages, so exponentials and logarithms have the same bits on all machines.

use std::f32::consts::{FRAC_1_SQRT_2, LN_2};
use std::fmt::Debug;
use std::ops::{AddAssign, SubAssign};

use num_traits::float::FloatCore;

/// `f32` or `f64`. Generic code uses the functions of this trait; on a concrete type, the inherent `exp` and `ln` hide
/// [`Real::exp`] and [`Real::ln`].
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

    /// Natural logarithm of a positive, normal number, the same on every machine. In `f32`, within 5e-7 from 1/400 to 400.
    fn ln(self) -> Self;

    /// Factor of the exponents of [`Real::falloff`].
    const FALLOFF_SCALE: f64;

    /// `e^(x / FALLOFF_SCALE)` for `x` up to 0, without branches, so that the compiler vectorises it. In `f32`, 2^-126 below
    /// -126, and for NaN. In `f64`, the bits of `libm::exp`; 0 below -700, and NaN for NaN.
    fn falloff(self) -> Self;
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

    /// `ln(x)` = n ln(2) + ln(m) with m between the roots of 1/2 and 2, and the series of the inverse hyperbolic tangent.
    #[inline(always)]
    fn ln(self) -> f32 {
        // Relative to the bits of the root of 1/2, so that m is between the roots.
        let bits = self.to_bits().wrapping_sub(FRAC_1_SQRT_2.to_bits());
        let n = (bits as i32 >> 23) as f32;
        let m = f32::from_bits((bits & 0x007f_ffff) + FRAC_1_SQRT_2.to_bits());
        let s = (m - 1.0) / (m + 1.0);
        let ss = s * s;
        // The remainder is below 2^-25 for |s| <= 0.172.
        let tail = ss * (1.0 / 3.0 + ss * (1.0 / 5.0 + ss * (1.0 / 7.0)));
        n * LN_2 + 2.0 * (s + s * tail)
    }

    const FALLOFF_SCALE: f64 = std::f64::consts::LOG2_E;

    /// As [`Real::exp`].
    #[inline(always)]
    fn falloff(self) -> f32 {
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

const LN_2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
const LN_2_LOW: f64 = f64::from_bits(0x3dea_39ef_3579_3c76);
const LN_2_INVERSE: f64 = f64::from_bits(0x3ff7_1547_652b_82fe);
/// Coefficients of the rational function.
const P: [f64; 5] = [
    f64::from_bits(0x3fc5_5555_5555_553e),
    f64::from_bits(0xbf66_c16c_16be_bd93),
    f64::from_bits(0x3f11_566a_af25_de2c),
    f64::from_bits(0xbebb_bd41_c5d2_6bf1),
    f64::from_bits(0x3e66_3769_72be_a4d0),
];

/// Magnitudes from which `1 + x` is no longer exact enough, and `k` is -1, and less.
const TINY_END: f64 = f64::from_bits(0x3e30_0001_0000_0000);
const ONE_BEGIN: f64 = f64::from_bits(0x3fd6_2e43_0000_0000);
const MORE_BEGIN: f64 = f64::from_bits(0x3ff0_a2b2_0000_0000);

/// Below it the result is 0 here; the result of `libm` is less than 1e-304.
const LEAST: f64 = -700.0;

/// Its mantissa has the bits of an integer that is added to it.
const SHIFTER: f64 = 6_755_399_441_055_744.0;

/// `yes` or `no`, by their bits: the compiler turns a conditional expression into a branch, and the lanes into scalars.
#[inline(always)]
fn pick(condition: bool, yes: f64, no: f64) -> f64 {
    let mask = u64::from(condition).wrapping_neg();
    f64::from_bits((yes.to_bits() & mask) | (no.to_bits() & !mask))
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

    fn ln(self) -> f64 {
        libm::log(self)
    }

    const FALLOFF_SCALE: f64 = 1.0;

    /// The algorithm of `libm` reduces its argument to `x = k ln 2 + r` and evaluates a rational function of `r`. Where
    /// `libm` branches, this selects. `libm` compares the high words of numbers; here they are compared with the numbers
    /// at which the high word changes.
    #[inline(always)]
    fn falloff(self) -> f64 {
        let x = self;
        let size = x.abs();
        let many = (LN_2_INVERSE * x - 0.5).trunc();
        let one = pick(size >= ONE_BEGIN, -1.0, 0.0);
        let k = pick(size >= MORE_BEGIN, many, one);
        let high = x - k * LN_2_HIGH;
        let low = k * LN_2_LOW;
        let r = high - low;
        let rr = r * r;
        let c = r - rr * (P[0] + rr * (P[1] + rr * (P[2] + rr * (P[3] + rr * P[4]))));
        let reduced = 1.0 + (r * c / (2.0 - c) - low + high);
        let power = f64::from_bits((k + (SHIFTER + 1023.0)).to_bits() << 52);
        let value = pick(size >= TINY_END, reduced * power, 1.0 + x);
        pick(x < LEAST, 0.0, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn falloff_has_the_precision_of_its_type() {
        let mut worst = 0.0_f64;
        for i in 0..=125_900 {
            let x = i as f32 * -1e-3;
            let exact = libm::exp2(f64::from(x));
            worst = worst.max((f64::from(x.falloff()) / exact - 1.0).abs());
        }
        assert!(worst < 2.5e-7, "{worst:e}");
        assert_eq!(0.0_f32.falloff(), 1.0);
        let least = [f32::NEG_INFINITY, -300.0, -126.0, f32::NAN].map(Real::falloff);
        assert_eq!(least, [2.0_f32.powi(-126); 4]);
    }

    #[test]
    fn ln_has_the_precision_of_its_type() {
        let mut worst = 0.0_f64;
        for i in 1..=200_000 {
            let x = i as f32 * 2e-3;
            worst = worst.max((f64::from(Real::ln(x)) - libm::log(f64::from(x))).abs());
        }
        assert!(worst < 5e-7, "{worst:e}");
        assert_eq!(Real::ln(1.0_f32), 0.0);
    }

    #[test]
    fn exp_of_extremes() {
        assert_eq!(Real::exp(0.0_f32), 1.0);
        assert_eq!(Real::exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(Real::exp(-88.0_f32), 0.0);
        assert!(Real::exp(f32::INFINITY) > 1e38);
        assert!(Real::exp(f32::NAN).is_nan());
    }

    fn check(x: f64) {
        let expected = libm::exp(x);
        let value = x.falloff();
        assert_eq!(value.to_bits(), expected.to_bits(), "exp({x:e}): {value:e}");
    }

    #[test]
    fn falloff_has_the_bits_of_libm() {
        let mut random = fastrand::Rng::with_seed(3);
        for _ in 0..200_000 {
            check(-random.f64());
            check(-6.0 * random.f64());
            check(LEAST * random.f64());
            check(-libm::exp2(-60.0 * random.f64()));
        }
        for x in [0.0, -0.0, LEAST] {
            check(x);
        }
        for k in 1..1000 {
            // Around the multiples of half of ln 2, where k changes.
            let x = -0.5 * std::f64::consts::LN_2 * f64::from(k);
            (-20..20).for_each(|ulps: i64| check(f64::from_bits(x.to_bits().wrapping_add_signed(ulps))));
        }
        for begin in [TINY_END, ONE_BEGIN, MORE_BEGIN] {
            for step in [1, 1 << 16, 1 << 32, 1 << 33] {
                (-20..20).for_each(|ulps: i64| {
                    check(-f64::from_bits(begin.to_bits().wrapping_add_signed(step * ulps)));
                });
            }
        }
        assert!(f64::NAN.falloff().is_nan());
        assert_eq!([-701.0, -1e9, f64::NEG_INFINITY, -0.0].map(Real::falloff), [0.0, 0.0, 0.0, 1.0]);
    }
}
