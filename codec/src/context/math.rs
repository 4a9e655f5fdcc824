//! Exponential, logarithm, sine and cosine with the same bits on every machine.
//!
//! System functions differ in their last bits between machines, which breaks a coder whose steps
//! depend on decoded numbers. These are IEEE additions, multiplications and divisions in the order
//! written, without fused multiply-add.

use crate::gaussian::{Arithmetic, CONTEXTS, Unit};

/// ln 2, and its split into upper and lower bits, 0.69314718036912382 and 1.9082149292705877e-10,
/// for argument reduction without rounding.
const LN_2: f64 = std::f64::consts::LN_2;
const LN_2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
const LN_2_LOW: f64 = f64::from_bits(0x3dea_39ef_3579_3c76);

/// The integer nearest to `x`, halves rounded up.
pub(super) fn round(x: f64) -> f64 {
    let x = x + 0.5;
    // `floor` is a call on some machines. Numbers beyond 2^52 are integers.
    if x.abs() >= 4_503_599_627_370_496.0 {
        return x;
    }
    let truncated = x as i64 as f64;
    if truncated > x { truncated - 1.0 } else { truncated }
}

/// `e^x` for `x` cut to `[-700, 700]`; relative error below 4e-16.
pub(super) fn exp(x: f64) -> f64 {
    let x = x.clamp(-700.0, 700.0);
    let octaves = round(x / LN_2);
    let r = (x - octaves * LN_2_HIGH) - octaves * LN_2_LOW;
    // Taylor series; |r| <= 0.35.
    let sum = INVERSE_FACTORIALS[..15].iter().rev().fold(0.0, |sum, term| sum * r + term);
    sum * f64::from_bits(((1023.0 + octaves) as u64) << 52)
}

/// Natural logarithm of a normal positive `x`; absolute error below 4e-16 near 1, relative error
/// below 4e-16 elsewhere. Other numbers are replaced by the smallest normal one.
pub(super) fn ln(x: f64) -> f64 {
    let bits = x.max(f64::MIN_POSITIVE).to_bits();
    let mut octaves = (bits >> 52) as f64 - 1023.0;
    let mut m = f64::from_bits(bits & 0x000f_ffff_ffff_ffff | 1023 << 52);
    if m > std::f64::consts::SQRT_2 {
        m *= 0.5;
        octaves += 1.0;
    }
    let f = (m - 1.0) / (m + 1.0);
    let f2 = f * f;
    // ln m = 2 artanh f; |f| <= 0.172.
    let sum = INVERSE_ODD.iter().rev().fold(0.0, |sum, term| sum * f2 + term);
    octaves * LN_2_HIGH + (2.0 * f * sum + octaves * LN_2_LOW)
}

/// Sine and cosine of `x` in `[0, pi / 2]`; absolute error below 4e-16.
pub(super) fn sin_cos(x: f64) -> (f64, f64) {
    // Taylor series.
    let x2 = x * x;
    let terms = INVERSE_FACTORIALS.chunks_exact(2).rev();
    let (sin, cos) = terms.fold((0.0, 0.0), |(sin, cos), c| (c[1] - sin * x2, c[0] - cos * x2));
    (sin * x, cos)
}

/// `1 / n!` for n = 0 to 23.
const INVERSE_FACTORIALS: [f64; 24] = {
    let mut inverse = [1.0; 24];
    let mut factorial = 1.0;
    let mut n = 1;
    while n < 24 {
        // Exact up to 22!.
        factorial *= n as f64;
        inverse[n] = 1.0 / factorial;
        n += 1;
    }
    inverse
};

/// `1 / (2 n + 1)` for n = 0 to 11.
const INVERSE_ODD: [f64; 12] = {
    let mut inverse = [1.0; 12];
    let mut n = 1;
    while n < 12 {
        inverse[n] = 1.0 / (2 * n + 1) as f64;
        n += 1;
    }
    inverse
};

/// The arithmetic of the coder `context`. Format.
pub(super) struct Math;

impl Arithmetic for Math {
    fn round(x: f64) -> f64 {
        round(x)
    }

    fn exp(x: f64) -> f64 {
        exp(x)
    }

    fn ln(x: f64) -> f64 {
        ln(x)
    }

    fn sin_cos(x: f64) -> (f64, f64) {
        sin_cos(x)
    }

    fn in_units(x: f64, unit: Unit) -> f64 {
        x / unit.size
    }

    fn average(mean: &mut f64, number: f64, seen: u32, window: u32) {
        let difference = number - *mean;
        // Exact for a power of two, and faster than a division.
        let part = |count: u32| 1.0 / f64::from(count);
        *mean += if seen < window { difference / f64::from(seen) } else { difference * part(window) };
    }

    fn context(expected: f64, spread: [f64; 2]) -> usize {
        context_of(expected * (spread[0] / spread[1]))
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::half_octaves;

    #[test]
    fn functions_agree_with_the_system() {
        for i in -4000..4000 {
            let x = f64::from(i) * 0.017;
            assert!((exp(x) / x.exp() - 1.0).abs() < 4e-16, "exp {x}");
            let y = x.exp();
            assert!((ln(y) - y.ln()).abs() <= 4e-16 * y.ln().abs().max(1.0), "ln {y}");
        }
        for i in 0..=1000 {
            let x = f64::from(i) * std::f64::consts::FRAC_PI_2 / 1000.0;
            let (sin, cos) = sin_cos(x);
            assert!((sin - x.sin()).abs() < 4e-16 && (cos - x.cos()).abs() < 4e-16, "{x}");
        }
    }

    #[test]
    fn every_argument_has_a_finite_value() {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e300, -1e300, 5e-324] {
            assert!(!exp(x).is_infinite(), "exp {x}");
            assert!(!ln(x).is_nan(), "ln {x}");
        }
    }

    #[test]
    fn halves_round_up() {
        assert_eq!([-1.5, -0.5, 0.5, 1.5, 0.4, -0.6].map(round), [-1.0, 0.0, 1.0, 2.0, 0.0, -1.0]);
    }

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
}
