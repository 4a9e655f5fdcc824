//! Quantisers of the coder `fixed`: numbers to codes and back, a pair of functions each.
//!
//! Decoding uses only IEEE additions, multiplications, divisions and square roots, in the order
//! written, so that every machine decodes the same bits.

use half::f16;

/// 8-bit codes over a range: `min + step * code`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Range8 {
    pub(crate) min: f32,
    pub(crate) step: f32,
}

impl Range8 {
    pub(crate) fn value(self, code: u8) -> f32 {
        self.min + self.step * f32::from(code)
    }
}

/// Codes of `BITS` bits around an exact zero: `step * (code - 2^(BITS - 1))`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Signed<const BITS: u32> {
    pub(crate) step: f32,
}

impl<const BITS: u32> Signed<BITS> {
    const ZERO: i32 = 1 << (BITS - 1);

    pub(crate) fn value(self, code: u16) -> f32 {
        self.step * (i32::from(code) - Self::ZERO) as f32
    }
}

/// Opacity of an 8-bit code.
pub(crate) fn opacity_value(code: u8) -> f32 {
    f32::from(code) / 255.0
}

/// Unit quaternion of four 8-bit codes, each offset by 128; `None` if all components are zero.
pub(crate) fn rotation_value(codes: [u8; 4]) -> Option<[f32; 4]> {
    let q = codes.map(|code| i32::from(code) - 128);
    let square: i32 = q.iter().map(|c| c * c).sum();
    (square > 0).then(|| {
        let norm = (square as f32).sqrt();
        q.map(|c| c as f32 / norm)
    })
}

/// Value of an FP16 bit pattern.
pub(crate) fn f16_value(bits: u16) -> f32 {
    f16::from_bits(bits).to_f32()
}

#[cfg(feature = "encode")]
mod encode {
    use super::{Range8, Signed};
    use half::f16;

    impl Range8 {
        /// The range of `values`, except those more than `span` below the largest.
        pub(crate) fn over(values: impl Iterator<Item = f32>, span: f32) -> Range8 {
            let (low, high) =
                values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
            let min = low.max(high - span);
            Range8 { min, step: (high - min) / 255.0 }
        }

        pub(crate) fn code(self, value: f32) -> u8 {
            // The cast saturates where the range leaves out a number.
            if self.step == 0.0 { 0 } else { ((value - self.min) / self.step).round() as u8 }
        }
    }

    impl<const BITS: u32> Signed<BITS> {
        const MAX: i32 = (1 << (BITS - 1)) - 1;

        /// Step of codes up to a magnitude of 1.
        pub(crate) const RELATIVE_STEP: f32 = 1.0 / Self::MAX as f32;

        /// Codes up to the magnitude `largest`, with a step of at least `finest`. If `largest` rounds to zero, the step
        /// is zero.
        pub(crate) fn over(largest: f32, finest: f32) -> Self {
            let step = (largest / Self::MAX as f32).max(finest);
            Signed { step: if largest < 0.5 * step { 0.0 } else { step } }
        }

        pub(crate) fn code(self, value: f32) -> u16 {
            let steps = if self.step == 0.0 { 0 } else { (value / self.step).round() as i32 };
            (steps.clamp(-Self::MAX, Self::MAX) + Self::ZERO) as u16
        }
    }

    pub(crate) fn opacity_code(opacity: f32) -> u8 {
        (opacity * 255.0).round() as u8
    }

    /// Codes of a unit quaternion, and whether it was negated, which is the same rotation. The
    /// largest component always becomes +127: the 8 bits code the direction, and the decoder
    /// normalises.
    pub(crate) fn rotation_codes(q: [f32; 4]) -> ([u8; 4], bool) {
        let largest =
            q.into_iter().fold(0.0f32, |largest, c| if c.abs() > largest.abs() { c } else { largest });
        (q.map(|c| (c / largest * 127.0).round() as i32 + 128).map(|c| c as u8), largest < 0.0)
    }

    /// Nearest finite FP16 number.
    pub(crate) fn f16_finite(x: f32) -> u16 {
        f16::from_f32(x.clamp(f16::MIN.to_f32(), f16::MAX.to_f32())).to_bits()
    }

    /// Nearest FP16 number above zero; infinity (always on) beyond the largest finite one.
    pub(crate) fn f16_positive(x: f32) -> u16 {
        f16::from_f32(x).to_bits().max(1)
    }
}

#[cfg(feature = "encode")]
pub(crate) use encode::{f16_finite, f16_positive, opacity_code, rotation_codes};

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn range_errors_are_at_most_half_a_step() {
        let values: Vec<f32> = (0..1000).map(|i| (i as f32 * 0.37).sin() * 5.0 - 2.0).collect();
        let range = Range8::over(values.iter().copied(), f32::INFINITY);
        for x in &values {
            let error = (range.value(range.code(*x)) - x).abs();
            assert!(error <= 0.5 * range.step + 1e-6, "{x} is off by {error}");
        }
        assert!((range.step - 10.0 / 255.0).abs() < 1e-4);
        assert_eq!(Range8::over([3.5; 4].into_iter(), 16.0), Range8 { min: 3.5, step: 0.0 });
    }

    #[test]
    fn a_span_limits_the_low_end_only() {
        let range = Range8::over([-1e9, -3.0, 1.0].into_iter(), 16.0);
        assert_eq!(range.code(-1e9), 0);
        assert_eq!(range.value(0), -15.0);
        assert!((range.value(range.code(-3.0)) + 3.0).abs() <= 0.5 * 16.0 / 255.0);
        assert_eq!(range.code(1.0), 255);
    }

    #[test]
    fn signed_codes_keep_zero_and_the_extremes() {
        let range = Signed::<10>::over(2.0, 0.0);
        assert_eq!(range.value(range.code(0.0)), 0.0);
        assert!((range.value(range.code(-2.0)) + 2.0).abs() < 1e-6);
        assert_eq!((range.code(-2.0), range.code(0.0), range.code(2.0)), (1, 512, 1023));
        for i in -200..=200 {
            let x = i as f32 / 100.0;
            assert!((range.value(range.code(x)) - x).abs() <= 0.5 * range.step + 1e-6, "{x}");
        }
    }

    #[test]
    fn numbers_that_round_to_zero_have_no_step() {
        assert_eq!(Signed::<8>::over(0.49, 1.0).step, 0.0);
        assert_eq!(Signed::<8>::over(0.51, 1.0).step, 1.0);
        assert_eq!(Signed::<8>::over(0.0, 0.0).step, 0.0);
        assert_eq!(Signed::<10> { step: 0.0 }.code(1.0), 512);
    }

    #[test]
    fn coding_decoded_opacities_and_windows_changes_nothing() {
        for code in 0..=255 {
            assert_eq!(opacity_code(opacity_value(code)), code);
        }
        for bits in (1..=0x7c00).step_by(7) {
            assert_eq!(f16_positive(f16_value(bits)), bits);
            if bits < 0x7c00 {
                assert_eq!(f16_finite(f16_value(bits)), bits);
                assert_eq!(f16_finite(-f16_value(bits)), bits | 0x8000);
            }
        }
    }

    #[test]
    fn fp16_saturates() {
        assert_eq!(f16_value(f16_positive(1e-30)), 2f32.powi(-24), "widths stay positive");
        assert_eq!(f16_value(f16_positive(1e6)), f32::INFINITY, "wide is always on");
        assert_eq!(f16_value(f16_finite(f32::MAX)), 65504.0);
        assert_eq!(f16_value(f16_finite(-1e6)), -65504.0);
    }

    #[test]
    fn rotations_round_trip_up_to_sign() {
        for i in 0..500 {
            let angle = i as f32 * 0.1;
            let q =
                [angle.sin() * 0.6, angle.cos() * 0.6, (angle * 1.7).sin() * 0.8, (angle * 1.7).cos() * 0.8];
            let (codes, negated) = rotation_codes(q);
            assert_eq!(codes.iter().max(), Some(&255), "the largest component is 127");
            let r = rotation_value(codes).unwrap();
            let norm: f32 = r.iter().map(|c| c * c).sum();
            assert!((norm - 1.0).abs() < 1e-6);
            let sign = if negated { -1.0 } else { 1.0 };
            for k in 0..4 {
                assert!((r[k] - sign * q[k]).abs() < 1.0 / 127.0, "component {k} of {q:?}: {r:?}");
            }
        }
        assert_eq!(rotation_value([128; 4]), None);
    }
}
