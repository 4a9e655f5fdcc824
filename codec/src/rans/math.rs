//! The arithmetic with which numbers are computed from symbols. Format.
//!
//! System functions differ in their last bits between machines, which breaks a coder whose steps depend on decoded
//! numbers. These are IEEE additions, multiplications and divisions in the order written, without fused multiply-add.
//!
//! Exponential, logarithm, sine and cosine take few operations: tables of 64 numbers and short polynomials. Decoded
//! numbers are binary32, so relative errors of 1e-10 do not show in them.

/// Contexts of an integer: expected magnitudes of 2^-4, 2^-3.5, ..., 2^15.5. Format.
pub(crate) const CONTEXTS: usize = 40;

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
    pub(crate) fn over(self, divisor: Unit) -> Unit {
        Unit { size: in_units(self.size, divisor), inverse: self.inverse * divisor.size }
    }
}

/// `2^(halves / 2)`.
pub(crate) fn half_octaves(halves: u32) -> f64 {
    let octaves = f64::from_bits((1023 + u64::from(halves / 2)) << 52);
    if halves.is_multiple_of(2) { octaves } else { octaves * std::f64::consts::SQRT_2 }
}

/// Adding it and subtracting it again rounds a number below 2^51 to an integer, halves to even ones. The lower bits
/// of the sum are the integer.
const ROUNDING: f64 = 6_755_399_441_055_744.0;

/// ln 2 / 64, and its split into upper and lower bits, so that multiples of the upper part are exact.
const STEPS_PER_UNIT: f64 = 64.0 / std::f64::consts::LN_2;
const STEP_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000) / 64.0;
const STEP_LOW: f64 = f64::from_bits(0x3dea_39ef_3579_3c76) / 64.0;

/// `1 / n`, for moving averages.
const INVERSES: [f64; 257] = {
    let mut inverses = [1.0; 257];
    let mut n = 2;
    while n < 257 {
        inverses[n] = 1.0 / n as f64;
        n += 1;
    }
    inverses
};

/// The integer nearest to `x`, halves rounded to even ones.
#[inline(always)]
pub(crate) fn round(x: f64) -> f64 {
    (x + ROUNDING) - ROUNDING
}

/// `e^x` for `x` cut to `[-700, 700]`.
#[inline(always)]
pub(crate) fn exp(x: f64) -> f64 {
    let x = x.clamp(-700.0, 700.0);
    let sum = x * STEPS_PER_UNIT + ROUNDING;
    let (steps, count) = (sum - ROUNDING, sum.to_bits() as i32);
    let r = (x - steps * STEP_HIGH) - steps * STEP_LOW;
    let power = POWERS[(count & 63) as usize].wrapping_add(((count >> 6) as u64) << 52);
    // Taylor series; |r| <= 0.0055.
    (1.0 + r * (1.0 + r * (1.0 / 2.0 + r * (1.0 / 6.0 + r * (1.0 / 24.0))))) * f64::from_bits(power)
}

/// Natural logarithm of a normal positive `x`; others are replaced by the smallest normal one.
#[inline(always)]
pub(crate) fn ln(x: f64) -> f64 {
    let bits = x.max(f64::MIN_POSITIVE).to_bits();
    let octaves = (bits >> 52) as i32 - 1023;
    let m = f64::from_bits(bits & 0x000f_ffff_ffff_ffff | 1023 << 52);
    let part = (bits >> 46 & 63) as usize;
    // |f| <= 1 / 128.
    let f = m * RECIPROCALS[part] - 1.0;
    let sum = f * (1.0 + f * (-1.0 / 2.0 + f * (1.0 / 3.0 + f * (-1.0 / 4.0 + f * (1.0 / 5.0)))));
    f64::from(octaves) * std::f64::consts::LN_2 + (f64::from_bits(LOGARITHMS[part]) + sum)
}

/// Sine and cosine of `x` in `[0, pi / 2]`, from sine and cosine of the half angle.
#[inline(always)]
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    const SIN: [f64; 6] = [1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0];
    const COS: [f64; 6] = [1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0];
    let half = 0.5 * x;
    let square = half * half;
    let series = |terms: [f64; 6]| terms.iter().rev().fold(0.0, |sum, term| sum * square + term);
    let (sin, cos) = (half * series(SIN), series(COS));
    (2.0 * sin * cos, 1.0 - 2.0 * sin * sin)
}

/// `x / unit`.
#[inline(always)]
pub(crate) fn in_units(x: f64, unit: Unit) -> f64 {
    x * unit.inverse
}

/// Adds the `seen`-th number to a moving average over `window` numbers, at most 256.
#[inline(always)]
pub(crate) fn average(mean: &mut f64, number: f64, seen: u32, window: u32) {
    *mean += (number - *mean) * INVERSES[seen.min(window) as usize];
}

/// The context of the magnitude `expected * numerator / denominator`: half octaves above 2^-4, rounded. From the
/// difference of the exponents, whose fractions are significands: less than 0.09 octaves off.
#[inline(always)]
pub(crate) fn context(expected: f64, [numerator, denominator]: [f64; 2]) -> usize {
    // 4 octaves, and half of a half octave for rounding.
    const BIAS: i64 = (4 << 52) + (1 << 50);
    let magnitude = (expected * numerator).min(1e30);
    let octaves = magnitude.to_bits() as i64 - denominator.to_bits() as i64;
    ((octaves + BIAS) >> 51).clamp(0, CONTEXTS as i64 - 1) as usize
}

/// `128 / (129 + 2 j)`: reciprocals of significands.
const RECIPROCALS: [f64; 64] = {
    let mut reciprocals = [0.0; 64];
    let mut j = 0;
    while j < 64 {
        reciprocals[j] = 128.0 / (129 + 2 * j) as f64;
        j += 1;
    }
    reciprocals
};

/// Bits of `2^(j / 64)`. Format.
pub(super) const POWERS: [u64; 64] = [
    0x3ff0_0000_0000_0000,
    0x3ff0_2c9a_3e77_8061,
    0x3ff0_59b0_d315_8574,
    0x3ff0_8745_1875_9bc8,
    0x3ff0_b558_6cf9_890f,
    0x3ff0_e3ec_32d3_d1a2,
    0x3ff1_1301_d012_5b51,
    0x3ff1_429a_aea9_2de0,
    0x3ff1_72b8_3c7d_517b,
    0x3ff1_a35b_eb6f_cb75,
    0x3ff1_d487_3168_b9aa,
    0x3ff2_063b_8862_8cd6,
    0x3ff2_387a_6e75_6238,
    0x3ff2_6b45_65e2_7cdd,
    0x3ff2_9e9d_f51f_dee1,
    0x3ff2_d285_a6e4_030b,
    0x3ff3_06fe_0a31_b715,
    0x3ff3_3c08_b264_16ff,
    0x3ff3_71a7_373a_a9cb,
    0x3ff3_a7db_34e5_9ff7,
    0x3ff3_dea6_4c12_3422,
    0x3ff4_160a_21f7_2e2a,
    0x3ff4_4e08_6061_892d,
    0x3ff4_86a2_b5c1_3cd0,
    0x3ff4_bfda_d536_2a27,
    0x3ff4_f9b2_769d_2ca7,
    0x3ff5_342b_569d_4f82,
    0x3ff5_6f47_36b5_27da,
    0x3ff5_ab07_dd48_5429,
    0x3ff5_e76f_15ad_2148,
    0x3ff6_247e_b03a_5585,
    0x3ff6_6238_8255_2225,
    0x3ff6_a09e_667f_3bcd,
    0x3ff6_dfb2_3c65_1a2f,
    0x3ff7_1f75_e8ec_5f74,
    0x3ff7_5feb_5642_67c9,
    0x3ff7_a114_73eb_0187,
    0x3ff7_e2f3_36cf_4e62,
    0x3ff8_2589_994c_ce13,
    0x3ff8_68d9_9b44_92ed,
    0x3ff8_ace5_422a_a0db,
    0x3ff8_f1ae_9915_7736,
    0x3ff9_3737_b0cd_c5e5,
    0x3ff9_7d82_9fde_4e50,
    0x3ff9_c491_82a3_f090,
    0x3ffa_0c66_7b5d_e565,
    0x3ffa_5503_b23e_255d,
    0x3ffa_9e6b_5579_fdbf,
    0x3ffa_e89f_995a_d3ad,
    0x3ffb_33a2_b84f_15fb,
    0x3ffb_7f76_f2fb_5e47,
    0x3ffb_cc1e_904b_c1d2,
    0x3ffc_199b_dd85_529c,
    0x3ffc_67f1_2e57_d14b,
    0x3ffc_b720_dcef_9069,
    0x3ffd_072d_4a07_897c,
    0x3ffd_5818_dcfb_a487,
    0x3ffd_a9e6_03db_3285,
    0x3ffd_fc97_337b_9b5f,
    0x3ffe_502e_e78b_3ff6,
    0x3ffe_a4af_a2a4_90da,
    0x3ffe_fa1b_ee61_5a27,
    0x3fff_5076_5b6e_4540,
    0x3fff_a7c1_819e_90d8,
];

/// Bits of `-ln(128 / (129 + 2 j))`, the quotient rounded. Format.
pub(super) const LOGARITHMS: [u64; 64] = [
    0x3f7f_e02a_6b10_6799,
    0x3f97_b91b_07d5_b126,
    0x3fa3_9e87_b9fe_bd68,
    0x3fab_42dd_7119_71b9,
    0x3fb1_6536_eea3_7ae3,
    0x3fb5_1b07_3f06_183c,
    0x3fb8_c345_d631_9b23,
    0x3fbc_5e54_8f5b_c743,
    0x3fbf_ec91_31db_eabc,
    0x3fc1_b72a_d52f_67a2,
    0x3fc3_71fc_201e_8f75,
    0x3fc5_26e5_e3a1_b438,
    0x3fc6_d60f_e719_d21b,
    0x3fc8_7fa0_6520_c911,
    0x3fca_23bc_1fe2_b561,
    0x3fcb_c286_742d_8cd4,
    0x3fcd_5c21_6b4f_bb94,
    0x3fce_f0ad_cbdc_5935,
    0x3fd0_4025_94b4_d041,
    0x3fd1_058b_f9ae_4ad4,
    0x3fd1_c898_c169_99fb,
    0x3fd2_895a_13de_86a4,
    0x3fd3_47dd_9a98_7d56,
    0x3fd4_0430_8686_a7e4,
    0x3fd4_be5f_9577_78a1,
    0x3fd5_7677_1745_5a6c,
    0x3fd6_2c82_f2b9_c796,
    0x3fd6_e08e_aa2b_a1e4,
    0x3fd7_92a5_5fdd_47a1,
    0x3fd8_42d1_da1e_8b18,
    0x3fd8_f11e_8736_62c8,
    0x3fd9_9d95_8117_e08a,
    0x3fda_4840_90e5_bb09,
    0x3fda_f129_3247_786b,
    0x3fdb_9858_9693_10fd,
    0x3fdc_3dd7_a7cd_ad4d,
    0x3fdc_e1af_0b85_f3ec,
    0x3fdd_83e7_258a_2f3e,
    0x3fde_2488_1a7c_6c26,
    0x3fde_c399_d246_8cc1,
    0x3fdf_6123_fa70_28ad,
    0x3fdf_fd2e_0857_f497,
    0x3fe0_4bdf_9da9_26d2,
    0x3fe0_986f_4f57_3521,
    0x3fe0_e449_85d1_cc8c,
    0x3fe1_2f71_9593_efbd,
    0x3fe1_79ea_bbd8_99a0,
    0x3fe1_c3b8_1f71_3c25,
    0x3fe2_0cdc_d192_ab6e,
    0x3fe2_555b_ce98_f7ca,
    0x3fe2_9d37_fec2_b08b,
    0x3fe2_e474_36e4_0268,
    0x3fe3_2b13_3912_1d71,
    0x3fe3_7117_b547_47b6,
    0x3fe3_b684_49ff_fc23,
    0x3fe3_fb5b_84d1_6f43,
    0x3fe4_3f9f_e2f9_ce67,
    0x3fe4_8353_d1ea_88df,
    0x3fe4_c679_afcc_ee39,
    0x3fe5_0913_cc01_686b,
    0x3fe5_4b24_6799_9498,
    0x3fe5_8cad_b5cd_7989,
    0x3fe5_cdb1_dc6c_1765,
    0x3fe6_0e32_f447_88d9,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_octaves_are_powers() {
        for halves in 0..60 {
            assert!((half_octaves(halves) / 2f64.powf(f64::from(halves) / 2.0) - 1.0).abs() < 4e-16);
        }
    }

    #[test]
    fn functions_agree_with_the_system() {
        for i in -4000..4000 {
            let x = f64::from(i) * 0.017;
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-13, "exp {x}");
            let y = x.exp();
            assert!((ln(y) - y.ln()).abs() <= 1e-13 * y.ln().abs().max(1.0), "ln {y}");
        }
        for i in 0..=1000 {
            let x = f64::from(i) * std::f64::consts::FRAC_PI_2 / 1000.0;
            let (sin, cos) = sin_cos(x);
            assert!((sin - x.sin()).abs() < 1e-9 && (cos - x.cos()).abs() < 1e-9, "{x}");
        }
    }

    #[test]
    fn every_argument_has_a_finite_value() {
        for x in [f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e300, -1e300, 5e-324] {
            assert!(exp(x).is_finite(), "exp {x}");
            assert!(ln(x).is_finite(), "ln {x}");
        }
        assert!(ln(f64::NAN).is_finite());
        for (a, b) in [(f64::NAN, 1.0), (f64::INFINITY, 0.05), (0.0, f64::MAX), (1e300, 1e-300)] {
            assert!(context(a, [a, b]) < CONTEXTS);
        }
    }

    #[test]
    fn halves_round_to_even_integers() {
        assert_eq!([-1.5, -0.5, 0.5, 1.5, 0.4, -0.6].map(round), [-2.0, 0.0, 0.0, 2.0, 0.0, -1.0]);
    }

    #[test]
    fn contexts_are_half_octaves() {
        for expected in 0..CONTEXTS {
            let mean = half_octaves(expected as u32) / 16.0;
            for factor in [0.9, 1.0, 1.1] {
                assert_eq!(context(mean * factor, [1.0; 2]), expected);
                assert_eq!(context(mean, [3.0 * factor, 3.0]), expected);
            }
        }
    }
}
