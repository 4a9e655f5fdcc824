//! Models of numbers made of adaptive distributions: [`TokenInteger`] and [`NibbleTree`].

use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

use super::{
    cdf::Cdf,
    math::CONTEXTS,
    observer::Attribute,
    start::Prior,
    start::{share, start, tree_pace},
    symbols::Symbols,
    token::{Form, Split, bypass_bits, joined, split},
};

/// Codes signed integers of magnitude below 2^26: a token, whose distribution depends on the context, and bypass bits.
#[derive(Clone, Debug)]
pub(crate) struct TokenInteger {
    form: Form,
    /// By context.
    cdfs: [Cdf; CONTEXTS],
}

impl TokenInteger {
    /// Number of the model of a component among the models of its attribute. The axes of a power of motion share a
    /// model, as do harmonics of the same degree and channel. Format.
    pub(crate) fn group(attribute: Attribute, component: usize) -> usize {
        match attribute {
            Attribute::Motion => component / 3,
            // Degree d begins with coefficient d^2.
            Attribute::Harmonics => 3 * ((component / 3 + 1).isqrt() - 1) + component % 3,
            _ => component,
        }
    }

    /// The initial model of an attribute.
    pub(crate) fn new(attribute: Attribute) -> TokenInteger {
        let cdfs = std::array::from_fn(|context| start(attribute, context));
        TokenInteger { form: Form::new(attribute), cdfs }
    }

    /// Bits that coding `value` takes.
    pub(crate) fn cost(&self, context: usize, value: i32) -> f64 {
        self.cdfs[context].cost(split(value, self.form, context).token)
            + f64::from(bypass_bits(value, self.form, context))
    }

    /// Codes an integer in a context, and adapts the model.
    #[inline(always)]
    pub(crate) fn code<S: Symbols>(&mut self, symbols: &mut S, context: usize, value: i32) -> i32 {
        let Split { token, mut rest } =
            if S::ENCODES { split(value, self.form, context) } else { Split::default() };
        let token = symbols.token(&mut self.cdfs[context], token);
        joined(token, self.form, context, |count| {
            let part = rest & ((1 << count) - 1);
            rest >>= count;
            symbols.bits(count, part as u32)
        })
    }
}

/// Codes unsigned numbers of up to 8 bits: the upper 4 as a symbol, then the others as one whose distribution depends
/// on the upper.
#[derive(Clone, Debug)]
pub(crate) struct NibbleTree {
    /// Numbers of bits of both symbols.
    upper_bits: u32,
    lower_bits: u32,
    /// The distribution of the upper symbol, then a distribution of the lower symbol for each upper symbol.
    cdfs: Vec<Cdf>,
}

/// Trees as they start, by number of bits. A chunk has about a hundred, whose many divisions take 2 % of the time of
/// decoding it.
static STARTS: Mutex<BTreeMap<(u32, Prior), NibbleTree>> = Mutex::new(BTreeMap::new());

impl NibbleTree {
    /// The initial model of numbers of `bits` bits, at most 8.
    pub(crate) fn new(bits: u32, prior: Prior) -> NibbleTree {
        let mut starts = STARTS.lock().unwrap_or_else(PoisonError::into_inner);
        starts.entry((bits, prior)).or_insert_with(|| NibbleTree::start(bits, prior)).clone()
    }

    fn start(bits: u32, prior: Prior) -> NibbleTree {
        let upper_bits = bits.min(4);
        let lower_bits = bits - upper_bits;
        let share = |value: u32| if value >> bits == 0 { share(value, bits, prior) } else { 0 };
        let lower = |upper: u32| -> [u32; 16] {
            std::array::from_fn(
                |i| if i >> lower_bits == 0 { share(upper << lower_bits | i as u32) } else { 0 },
            )
        };
        let pace = tree_pace(prior);
        let uppers: [u32; 16] = std::array::from_fn(|upper| lower(upper as u32).iter().sum());
        let mut cdfs = vec![Cdf::of_shares(uppers, pace)];
        if lower_bits > 0 {
            cdfs.extend((0..1 << upper_bits).map(|upper| Cdf::of_shares(lower(upper), pace)));
        }
        NibbleTree { upper_bits, lower_bits, cdfs }
    }

    /// Codes a number, and adapts the model.
    #[inline(always)]
    pub(crate) fn code(&mut self, symbols: &mut impl Symbols, value: u32) -> u32 {
        if self.upper_bits == 0 {
            return 0;
        }
        // In a damaged stream a symbol can be one of those that are never coded.
        let mut code = |cdf: &mut Cdf, bits: u32, value: u32| {
            symbols.token(cdf, value as usize) as u32 & ((1 << bits) - 1)
        };
        let upper = code(&mut self.cdfs[0], self.upper_bits, value >> self.lower_bits);
        if self.lower_bits == 0 {
            return upper;
        }
        let lower = value & ((1 << self.lower_bits) - 1);
        upper << self.lower_bits | code(&mut self.cdfs[1 + upper as usize], self.lower_bits, lower)
    }
}
