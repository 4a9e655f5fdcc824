//! [`Split`]: an integer as a token, whose distribution adapts, and bypass bits.
//!
//! The residual r is halved `k` times, so that its expected magnitude is at most 4; the bits that fall off are bypass
//! bits. What remains, mapped 0, -1, 1, -2, 2, ... to 0, 1, 2, 3, 4, ..., is the base of its token plus extra bits.

/// `(base, extra bits)` of each token but [`ESCAPE`]. Format.
const TOKENS: [(u32, u32); 16] = [
    (0, 0),
    (1, 0),
    (2, 0),
    (3, 0),
    (4, 0),
    (5, 0),
    (6, 0),
    (7, 0),
    (8, 0),
    (9, 1),
    (11, 1),
    (13, 2),
    (17, 3),
    (25, 4),
    (41, 5),
    (73, 0),
];

/// Token of numbers from its base on, with Exp-Golomb bits. Format.
const ESCAPE: usize = 15;

/// Bits that state the number of Exp-Golomb bits. Format.
const LENGTH_BITS: u32 = 5;

/// Largest magnitude of an integer. Format.
const INTEGER_MAX: i64 = (1 << 26) - 1;

/// An integer as a token and bypass bits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Split {
    pub(super) token: usize,
    /// The bits, in the order in which they are read from the lowest one on.
    pub(super) rest: u64,
}

/// Number of times that a residual in a context is halved.
#[inline(always)]
fn halvings(context: usize) -> u32 {
    (context.max(11) as u32 - 11) / 2
}

/// The token of an integer in a context, and its bypass bits.
pub(super) fn split(value: i32, context: usize) -> Split {
    let k = halvings(context);
    let low = u64::from(value as u32 & ((1 << k) - 1));
    let halved = value >> k;
    let mapped = (halved << 1 ^ halved >> 31) as u32;
    let token = TOKENS.partition_point(|&(base, _)| base <= mapped) - 1;
    let (base, _) = TOKENS[token];
    if token < ESCAPE {
        return Split { token, rest: u64::from(mapped - base) << k | low };
    }
    let above = mapped - base + 1;
    let length = above.ilog2();
    let rest = u64::from(length) | u64::from(above - (1 << length)) << LENGTH_BITS;
    Split { token, rest: rest | low << (LENGTH_BITS + length) }
}

/// The integer of a token, given a function that reads up to 32 bits.
#[inline(always)]
pub(super) fn joined(token: usize, context: usize, mut read: impl FnMut(u32) -> u32) -> i32 {
    if token >= ESCAPE {
        return escaped(context, read);
    }
    let k = halvings(context);
    let (base, extra) = TOKENS[token];
    let rest = read(extra + k);
    unmapped(base + (rest >> k)) << k | (rest & ((1 << k) - 1)) as i32
}

/// The integer of the token [`ESCAPE`]. Larger ones than any that is coded, in damaged streams, are cut.
#[cold]
fn escaped(context: usize, mut read: impl FnMut(u32) -> u32) -> i32 {
    let k = halvings(context);
    let length = read(LENGTH_BITS);
    let mapped = (1u64 << length) + u64::from(read(length)) - 1 + u64::from(TOKENS[ESCAPE].0);
    let halved = (mapped >> 1) as i64 ^ -((mapped & 1) as i64);
    (halved << k | i64::from(read(k))).clamp(-INTEGER_MAX, INTEGER_MAX) as i32
}

/// The integer that is mapped to a number.
#[inline(always)]
fn unmapped(mapped: u32) -> i32 {
    (mapped >> 1) as i32 ^ -((mapped & 1) as i32)
}

/// Number of bypass bits of an integer in a context.
pub(super) fn bypass_bits(value: i32, context: usize) -> u32 {
    let Split { token, rest } = split(value, context);
    let length = if token == ESCAPE { LENGTH_BITS + (rest as u32 & 31) } else { TOKENS[token].1 };
    length + halvings(context)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_of_every_size_round_trip() {
        let powers = (0..27)
            .flat_map(|e| [1 << e, (1 << e) - 1, (1 << e) - 2])
            .filter(|x| i64::from(*x) <= INTEGER_MAX);
        for value in powers.chain(0..300).flat_map(|x| [x, -x]) {
            for context in 0..40 {
                let Split { token, mut rest } = split(value, context);
                let mut bits = 0;
                let read = |count: u32| {
                    bits += count;
                    let part = rest & ((1 << count) - 1);
                    rest >>= count;
                    part as u32
                };
                assert_eq!(joined(token, context, read), value, "context {context}");
                assert_eq!((rest, bits), (0, bypass_bits(value, context)));
            }
        }
    }

    #[test]
    fn any_bits_are_an_integer() {
        for context in 0..40 {
            for token in 0..16 {
                for fill in [0, u32::MAX] {
                    let read = |count: u32| (u64::from(fill) & ((1 << count) - 1)) as u32;
                    assert!(i64::from(joined(token, context, read)).abs() <= INTEGER_MAX);
                }
            }
        }
    }
}
