//! Equally likely numbers: the upper bits as a part of the scale, the lower ones as bypass bits.

use super::cdf::SCALE_BITS;

/// Upper bits of a number that are a part of the scale. Format.
const UPPER_BITS: u32 = 8;

/// How to code one of `count` numbers, `1 <= count <= 65536`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Uniform {
    /// Number of lower bits.
    pub(super) lower_bits: u32,
    /// Number of values of the upper bits.
    uppers: u32,
}

/// `2^32 / n`, rounded up: `floor(x * it / 2^32)` is the quotient of `x` below 2^24 and `n`, for `n` up to 256.
const RECIPROCALS: [u64; (1 << UPPER_BITS) + 1] = {
    let mut reciprocals = [0; (1 << UPPER_BITS) + 1];
    let mut n = 1;
    while n <= 1 << UPPER_BITS {
        reciprocals[n as usize] = (1u64 << 32).div_ceil(n);
        n += 1;
    }
    reciprocals
};

impl Uniform {
    #[inline(always)]
    pub(super) fn new(count: u32) -> Uniform {
        let largest = count - 1;
        let lower_bits = (u32::BITS - largest.leading_zeros()).saturating_sub(UPPER_BITS);
        Uniform { lower_bits, uppers: (largest >> lower_bits) + 1 }
    }

    /// Start and length of the part of the upper bits.
    #[inline(always)]
    pub(super) fn part(self, upper: u32) -> (u32, u32) {
        let start = |upper: u32| {
            let above = u64::from((upper << SCALE_BITS) + self.uppers - 1);
            ((above * RECIPROCALS[self.uppers as usize]) >> 32) as u32
        };
        (start(upper), start(upper + 1) - start(upper))
    }

    /// The upper bits in whose part `slot` lies.
    #[inline(always)]
    pub(super) fn find(self, slot: u32) -> u32 {
        (slot * self.uppers) >> SCALE_BITS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rans::cdf::SCALE;

    #[test]
    fn parts_cover_the_scale() {
        for count in (1..=600).chain([4095, 4096, 4097, 65535, 65536]) {
            let uniform = Uniform::new(count);
            assert!(uniform.uppers <= 256 && uniform.uppers << uniform.lower_bits >= count);
            let mut end = 0;
            for upper in 0..uniform.uppers {
                let (start, length) = uniform.part(upper);
                assert_eq!(start, (upper << SCALE_BITS).div_ceil(uniform.uppers));
                assert_eq!(
                    (start, [start, start + length - 1].map(|slot| uniform.find(slot))),
                    (end, [upper; 2])
                );
                end = start + length;
            }
            assert_eq!(end, SCALE, "{count}");
        }
    }
}
