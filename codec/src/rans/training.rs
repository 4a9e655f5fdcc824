//! Trains the tables of `start.rs` on packages by the coder `rans`, of fields that were not coded before, and prints
//! them:
//!
//! `TRAIN="a.aarc b.aarc" cargo test --release -p codec --features encode training -- --ignored --nocapture`

use std::{collections::BTreeMap, env, fs};

use super::{
    cdf::{SCALE, SYMBOLS},
    decoder::Decoder,
    integer::{NibbleTree, TokenInteger},
    math::Math,
    search::LastCells,
    start::row,
    token::{BASES, Form, split},
};
use crate::{
    Coder, Limits, contents,
    gaussian::{Attribute, Reading, Symbols, decode_with},
    limits::Budget,
    rows::Rows,
};

/// Tokens of one attribute in one package that count in a row, at most: no field and no attribute decides alone.
const TOKENS_MAX: f64 = 20_000.0;

/// Tokens that the Laplace distribution of a row's magnitude counts as.
const LAPLACE_TOKENS: f64 = 200.0;

type Counts = BTreeMap<(Attribute, usize), [f64; SYMBOLS]>;

/// Counts the tokens that a decoder reads, by attribute and row of the table.
struct Counter<'a> {
    decoder: Decoder<'a>,
    counts: &'a mut Counts,
    attribute: Attribute,
}

impl Symbols for Counter<'_> {
    const ENCODES: bool = false;

    type Arithmetic = Math;
    type Integer = TokenInteger;
    type Tree = NibbleTree;
    type Search = LastCells;

    fn integer(&mut self, model: &mut TokenInteger, context: usize, value: i32) -> i32 {
        let value = self.decoder.integer(model, context, value);
        let form = Form::of(self.attribute);
        let counts = self.counts.entry((self.attribute, row(form, context))).or_default();
        counts[split(value, form, context).token] += 1.0;
        value
    }

    fn tree(&mut self, model: &mut NibbleTree, value: u32) -> u32 {
        self.decoder.tree(model, value)
    }

    fn uniform(&mut self, count: u32, value: u32) -> u32 {
        self.decoder.uniform(count, value)
    }

    fn bypass(&mut self, bits: u32, value: u64) -> u64 {
        self.decoder.bypass(bits, value)
    }

    fn begin(&mut self, attribute: Attribute, _: usize) {
        self.attribute = attribute;
    }
}

impl Reading for Counter<'_> {
    fn overrun(&self) -> bool {
        self.decoder.overrun()
    }

    fn left(&self) -> usize {
        self.decoder.left()
    }

    fn is_complete(&self) -> bool {
        self.decoder.is_complete()
    }
}

/// Counts the tokens of a package by the coder `rans`.
fn counts_of(path: &str) -> Counts {
    let package = fs::read(path).unwrap();
    let head = contents(&package, &Limits::default()).unwrap();
    assert_eq!(head.coder, Coder::Rans, "{path}");
    let mut counts = Counts::new();
    for (planned, section) in head.planned_sections() {
        let columns = head.columns().of(planned.region);
        let mut out = columns.zeros(planned.rows, &mut Budget::new(&Limits::default())).unwrap();
        let payload = section.payload(&package).unwrap();
        decode_with(payload, 2, columns, 0, Rows::all(&mut out), |bytes| Counter {
            decoder: Decoder::new(bytes, ()),
            counts: &mut counts,
            attribute: Attribute::Cells,
        })
        .unwrap();
    }
    counts
}

/// Probabilities of the tokens of integers with the expected magnitude of a context.
fn laplace(form: Form, context: usize) -> [f64; SYMBOLS] {
    let mean = 2f64.powf(context as f64 / 2.0) / 16.0;
    // Probability of a magnitude of at least x.
    let tail = |x: i64| if x <= 0 { 1.0 } else { ((0.5 - x as f64) / mean).exp() };
    let k = form.halvings(context);
    let of_mapped = |mapped: i64| match form {
        Form::Natural => tail(mapped << k) - tail((mapped + 1) << k),
        Form::Signed => {
            let halved = mapped >> 1 ^ -(mapped & 1);
            let (low, high) = (halved << k, (halved + 1) << k);
            match halved {
                0 => 1.0 - tail(1) + 0.5 * (tail(1) - tail(high)),
                1.. => 0.5 * (tail(low) - tail(high)),
                _ => 0.5 * (tail(1 - high) - tail(1 - low)),
            }
        }
    };
    let mut shares = [0.0; SYMBOLS];
    for (token, bases) in BASES.windows(2).enumerate() {
        shares[token] = (bases[0]..bases[1]).map(|mapped| of_mapped(i64::from(mapped))).sum();
    }
    shares[SYMBOLS - 1] = 1.0 - shares.iter().sum::<f64>();
    shares
}

#[test]
#[ignore = "needs packages to train on"]
fn training() {
    let paths = env::var("TRAIN").expect("TRAIN names packages");
    let packages: Vec<Counts> = paths.split_whitespace().map(counts_of).collect();
    for form in [Form::Signed, Form::Natural] {
        println!("{form:?}:");
        for of_row in 0..=row(form, 39).max(row(form, 38)) {
            let mut shares = laplace(form, of_row).map(|share| share.max(0.0) * LAPLACE_TOKENS);
            for (_, counts) in
                packages.iter().flatten().filter(|((a, r), _)| Form::of(*a) == form && *r == of_row)
            {
                let total: f64 = counts.iter().sum();
                let weight = (TOKENS_MAX / total).min(1.0);
                shares.iter_mut().zip(counts).for_each(|(share, count)| *share += weight * count);
            }
            let total: f64 = shares.iter().sum();
            let mut below = 0.0;
            let starts: Vec<String> = (0u32..)
                .zip(shares)
                .map(|(i, share)| {
                    let start = (below / total * f64::from(SCALE - SYMBOLS as u32)).round() as u32 + i;
                    below += share;
                    start.to_string()
                })
                .collect();
            println!("    [{}],", starts.join(", "));
        }
    }
}
