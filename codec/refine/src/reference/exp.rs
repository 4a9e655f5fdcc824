//! [`exp`] and [`log`] of several numbers at once, with the bits of [`libm::exp`] and [`libm::log`].
//!
//! The algorithms are the same. `exp` reduces its argument to `x = k ln 2 + r` and evaluates a rational function of
//! `r`; `log` separates the exponent `k` and evaluates a series in `f / (2 + f)` of the rest `1 + f`. Where `libm`
//! branches, all lanes select, in loops without calls, so that the compiler makes vectors of them. `libm` compares the
//! high words of numbers, here they are compared with the numbers at which the high word changes.

/// Numbers at once: as many as a vector of 256 bits has. Wider ones would be mostly outside the row of a small splat.
pub(super) const LANES: usize = 4;

/// One number per lane.
pub(super) type Lanes = [f64; LANES];

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

/// Coefficients of the series.
const LG: [f64; 7] = [
    f64::from_bits(0x3fe5_5555_5555_5593),
    f64::from_bits(0x3fd9_9999_9997_fa04),
    f64::from_bits(0x3fd2_4924_9422_9359),
    f64::from_bits(0x3fcc_71c5_1d8e_78af),
    f64::from_bits(0x3fc7_4664_96cb_03de),
    f64::from_bits(0x3fc3_9a09_d078_c69f),
    f64::from_bits(0x3fc2_f112_df3e_5244),
];

/// The bits of 1, those of the root of 1/2 with the low word 0, and those of a mantissa.
const ONE: u64 = 0x3ff0_0000_0000_0000;
const ROOT_HALF: u64 = 0x3fe6_a09e_0000_0000;
const MANTISSA: u64 = 0x000f_ffff_ffff_ffff;

/// Magnitudes from which `1 + x` is no longer exact enough, and `k` is -1, and less.
const TINY_END: f64 = f64::from_bits(0x3e30_0001_0000_0000);
const ONE_BEGIN: f64 = f64::from_bits(0x3fd6_2e43_0000_0000);
const MORE_BEGIN: f64 = f64::from_bits(0x3ff0_a2b2_0000_0000);

/// Below it the result is 0 here; that of `libm` is less than 1e-304.
pub(super) const LEAST: f64 = -700.0;

/// Its mantissa has the bits of an integer that is added to it.
const SHIFTER: f64 = 6_755_399_441_055_744.0;

/// `yes` or `no`, by their bits: the compiler turns a conditional expression into a branch, and the lanes into scalars.
#[inline(always)]
pub(super) fn pick(condition: bool, yes: f64, no: f64) -> f64 {
    let mask = u64::from(condition).wrapping_neg();
    f64::from_bits((yes.to_bits() & mask) | (no.to_bits() & !mask))
}

/// The exponentials of numbers from [`LEAST`] to 0; NaN of NaN.
#[inline(always)]
pub(super) fn exp(mut lanes: Lanes) -> Lanes {
    for lane in &mut lanes {
        let x = *lane;
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
        *lane = pick(x < LEAST, 0.0, value);
    }
    lanes
}

/// The natural logarithms of positive, normal and finite numbers.
#[inline(always)]
pub(super) fn log(mut lanes: Lanes) -> Lanes {
    for lane in &mut lanes {
        let bits = lane.to_bits() + (ONE - ROOT_HALF);
        let k = f64::from_bits((bits >> 52) | SHIFTER.to_bits()) - (SHIFTER + 1023.0);
        let f = f64::from_bits((bits & MANTISSA) + ROOT_HALF) - 1.0;
        let half_square = 0.5 * f * f;
        let s = f / (2.0 + f);
        let z = s * s;
        let w = z * z;
        let even = w * (LG[1] + w * (LG[3] + w * LG[5]));
        let odd = z * (LG[0] + w * (LG[2] + w * (LG[4] + w * LG[6])));
        *lane = s * (half_square + (odd + even)) + k * LN_2_LOW - half_square + f + k * LN_2_HIGH;
    }
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(x: f64) {
        let expected = libm::exp(x);
        for (lane, value) in exp([x, -1.0, x, x]).into_iter().enumerate().filter(|(lane, _)| *lane != 1) {
            assert_eq!(value.to_bits(), expected.to_bits(), "exp({x:e}) in lane {lane}: {value:e}");
        }
    }

    fn check_log(x: f64) {
        let expected = libm::log(x);
        for value in log([x; LANES]) {
            assert_eq!(value.to_bits(), expected.to_bits(), "log({x:e}): {value:e}");
        }
    }

    #[test]
    fn the_bits_are_those_of_libm() {
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
        for _ in 0..200_000 {
            check_log(1.0 + random.f64());
            check_log(0.5 + 255.0 * random.f64());
            check_log(libm::exp2(1000.0 * (2.0 * random.f64() - 1.0)));
        }
        for x in [1.0, 2.0, 255.0, f64::MIN_POSITIVE, f64::MAX, f64::from_bits(ROOT_HALF)] {
            (-20..20).for_each(|ulps: i64| {
                let x = f64::from_bits(x.to_bits().wrapping_add_signed(ulps));
                if x.is_normal() {
                    check_log(x);
                }
            });
        }
        assert!(exp([f64::NAN; LANES]).into_iter().all(f64::is_nan));
        assert_eq!(exp([-701.0, -1e9, f64::NEG_INFINITY, -0.0]), [0.0, 0.0, 0.0, 1.0]);
    }
}
