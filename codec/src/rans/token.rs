//! [`Split`]: an integer as a token, whose distribution adapts, and bypass bits.
//!
//! An integer is halved as often as its context says, so that its expected magnitude is at most 3, or 8 without sign;
//! the bits that fall off are bypass bits. What remains, mapped 0, -1, 1, -2, 2, ... to 0, 1, 2, 3, 4, ... if it has a
//! sign, is the base of its token plus extra bits.

use super::observer::Attribute;

/// Whether integers have a sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
    Natural,
    Signed,
}

impl Form {
    /// The form of the integers of an attribute. Opacities and widths are coded as distances from the largest. Format.
    pub(super) fn new(attribute: Attribute) -> Form {
        match attribute {
            Attribute::Opacity | Attribute::WindowWidth => Form::Natural,
            _ => Form::Signed,
        }
    }

    /// Number of times that an integer in a context is halved. Format.
    #[inline(always)]
    pub(super) fn halvings(self, context: usize) -> u32 {
        context.saturating_sub(self.whole_contexts()) as u32 / 2
    }

    /// Number of contexts below the first one in which integers may be halved. Format.
    pub(super) fn whole_contexts(self) -> usize {
        match self {
            Form::Natural => 13,
            Form::Signed => 9,
        }
    }
}

/// Base of each token. Format.
pub(super) const BASES: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, 17, 25, 41, 73];

/// Number of extra bits of each token but [`ESCAPE`].
const EXTRA_BITS: [u32; 16] = {
    let mut bits = [0; 16];
    let mut token = 0;
    while token + 1 < BASES.len() {
        bits[token] = (BASES[token + 1] - BASES[token]).ilog2();
        token += 1;
    }
    bits
};

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

/// The token of an integer in a context, and its bypass bits.
pub(super) fn split(value: i32, form: Form, context: usize) -> Split {
    let k = form.halvings(context);
    let low = u64::from(value as u32 & ((1 << k) - 1));
    let halved = value >> k;
    let mapped = match form {
        Form::Natural => halved.max(0) as u32,
        Form::Signed => (halved << 1 ^ halved >> 31) as u32,
    };
    let token = BASES.partition_point(|&base| base <= mapped) - 1;
    let base = BASES[token];
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
pub(super) fn joined(token: usize, form: Form, context: usize, mut read: impl FnMut(u32) -> u32) -> i32 {
    if token >= ESCAPE {
        return escaped(form, context, read);
    }
    let k = form.halvings(context);
    let rest = read(EXTRA_BITS[token] + k);
    let mapped = BASES[token] + (rest >> k);
    let halved = match form {
        Form::Natural => mapped as i32,
        Form::Signed => (mapped >> 1) as i32 ^ -((mapped & 1) as i32),
    };
    halved << k | (rest & ((1 << k) - 1)) as i32
}

/// The integer of the token [`ESCAPE`]. Larger ones than any that is coded, in damaged streams, are cut.
#[cold]
fn escaped(form: Form, context: usize, mut read: impl FnMut(u32) -> u32) -> i32 {
    let k = form.halvings(context);
    let length = read(LENGTH_BITS);
    let mapped = (1u64 << length) + u64::from(read(length)) - 1 + u64::from(BASES[ESCAPE]);
    let halved = match form {
        Form::Natural => mapped as i64,
        Form::Signed => (mapped >> 1) as i64 ^ -((mapped & 1) as i64),
    };
    (halved << k | i64::from(read(k))).clamp(-INTEGER_MAX, INTEGER_MAX) as i32
}

/// Number of bypass bits of an integer in a context.
pub(super) fn bypass_bits(value: i32, form: Form, context: usize) -> u32 {
    let Split { token, rest } = split(value, form, context);
    let length = if token == ESCAPE { LENGTH_BITS + (rest as u32 & 31) } else { EXTRA_BITS[token] };
    length + form.halvings(context)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMS: [Form; 2] = [Form::Natural, Form::Signed];

    #[test]
    fn integers_of_every_size_round_trip() {
        let powers = (0..27).flat_map(|e| [1 << e, (1 << e) - 1, (1 << e) - 2]);
        for magnitude in powers.filter(|x| (0..=INTEGER_MAX).contains(&i64::from(*x))).chain(0..300) {
            for (value, form) in [(magnitude, FORMS[0]), (magnitude, FORMS[1]), (-magnitude, FORMS[1])] {
                for context in 0..40 {
                    let Split { token, mut rest } = split(value, form, context);
                    let mut bits = 0;
                    let read = |count: u32| {
                        bits += count;
                        let part = rest & ((1 << count) - 1);
                        rest >>= count;
                        part as u32
                    };
                    assert_eq!(joined(token, form, context, read), value, "{form:?}, context {context}");
                    assert_eq!((rest, bits), (0, bypass_bits(value, form, context)));
                }
            }
        }
    }

    #[test]
    fn any_bits_are_an_integer() {
        for (form, context) in FORMS.into_iter().flat_map(|form| (0..40).map(move |c| (form, c))) {
            for (token, fill) in (0..16).flat_map(|token| [(token, 0), (token, u32::MAX)]) {
                let read = |count: u32| (u64::from(fill) & ((1 << count) - 1)) as u32;
                assert!(i64::from(joined(token, form, context, read)).abs() <= INTEGER_MAX);
            }
        }
    }
}
