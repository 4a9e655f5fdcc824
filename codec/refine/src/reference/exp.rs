//! [`exp`] of several numbers at once, with the bits of [`libm::exp`].
//!
//! The algorithm is the same: it reduces its argument to `x = k ln 2 + r` and evaluates a rational function of `r`.
//! Where `libm` branches, all lanes select, in loops without calls, so that the compiler makes vectors of them. `libm`
//! compares the high words of numbers, here they are compared with the numbers at which the high word changes.

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

/// Magnitudes from which `1 + x` is no longer exact enough, and `k` is -1, and less.
const TINY_END: f64 = f64::from_bits(0x3e30_0001_0000_0000);
const ONE_BEGIN: f64 = f64::from_bits(0x3fd6_2e43_0000_0000);
const MORE_BEGIN: f64 = f64::from_bits(0x3ff0_a2b2_0000_0000);

/// Below it the result is 0 here; the result of `libm` is less than 1e-304.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn check(x: f64) {
        let expected = libm::exp(x);
        for (lane, value) in exp([x, -1.0, x, x]).into_iter().enumerate().filter(|(lane, _)| *lane != 1) {
            assert_eq!(value.to_bits(), expected.to_bits(), "exp({x:e}) in lane {lane}: {value:e}");
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
        assert!(exp([f64::NAN; LANES]).into_iter().all(f64::is_nan));
        assert_eq!(exp([-701.0, -1e9, f64::NEG_INFINITY, -0.0]), [0.0, 0.0, 0.0, 1.0]);
    }
}
