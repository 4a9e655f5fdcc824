//! Prints the start tables of `start.rs`, trained on packages: `TRAIN="a.aarc b.aarc" cargo test --release -p codec
//! --features encode training -- --ignored --nocapture`.

use std::{cell::RefCell, env, fs};

use super::{
    decoder::Decoder,
    integer::{NibbleTree, TokenInteger},
    math::Math,
    search::LastCells,
    token::{Form, split},
};
use crate::{
    Coder, EncodeOptions, Limits, Precision, Source, contents, decode, encode,
    gaussian::{Attribute, Reading, Symbols, decode_with},
    rows::Rows,
};

thread_local! {
    static LOG: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Sees the tokens that a decoder reads.
struct Trainer<'a> {
    decoder: Decoder<'a>,
    attribute: (Attribute, usize),
}

impl Symbols for Trainer<'_> {
    const ENCODES: bool = false;

    type Arithmetic = Math;
    type Integer = TokenInteger;
    type Tree = NibbleTree;
    type Search = LastCells;

    fn integer(&mut self, model: &mut TokenInteger, context: usize, value: i32) -> i32 {
        let value = self.decoder.integer(model, context, value);
        let token = split(value, Form::of(self.attribute.0), context).token;
        LOG.with(|log| {
            log.borrow_mut()
                .push_str(&format!("{:?} {} {context} {token}\n", self.attribute.0, self.attribute.1))
        });
        value
    }

    fn tree(&mut self, model: &mut NibbleTree, value: u32) -> u32 {
        let bits = model.bits();
        let value = self.decoder.tree(model, value);
        LOG.with(|log| {
            log.borrow_mut()
                .push_str(&format!("{:?}Tree {} {bits} {value}\n", self.attribute.0, self.attribute.1))
        });
        value
    }

    fn uniform(&mut self, count: u32, value: u32) -> u32 {
        self.decoder.uniform(count, value)
    }

    fn bypass(&mut self, bits: u32, value: u64) -> u64 {
        self.decoder.bypass(bits, value)
    }

    fn begin(&mut self, attribute: Attribute, component: usize) {
        self.attribute = (attribute, component);
    }
}

impl Reading for Trainer<'_> {
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

#[test]
#[ignore = "needs packages"]
fn training() {
    for path in env::var("TRAIN").unwrap().split_whitespace() {
        let clip = decode(&fs::read(path).unwrap(), &Limits::default()).unwrap();
        let field = clip.merged();
        let source = Source { info: &clip.info, field: &field, plate: clip.plate.as_ref() };
        let options =
            EncodeOptions { coder: Coder::Rans, layers: Vec::new(), precision: Precision::default() };
        let package = encode(&source, &options).unwrap();
        let head = contents(&package, &Limits::default()).unwrap();
        for (planned, section) in head.planned_sections() {
            LOG.with(|log| log.borrow_mut().push_str("chunk 0 0 0\n"));
            let columns = head.columns().of(planned.region);
            let mut field =
                columns.zeros(planned.rows, &mut crate::limits::Budget::new(&Limits::default())).unwrap();
            let payload = section.payload(&package).unwrap();
            decode_with(payload, 2, columns, 0, Rows::all(&mut field), |bytes| Trainer {
                decoder: Decoder::new(bytes, ()),
                attribute: (Attribute::Cells, 0),
            })
            .unwrap();
        }
        LOG.with(|log| fs::write(format!("{path}.tokens"), std::mem::take(&mut *log.borrow_mut())).unwrap());
    }
}
