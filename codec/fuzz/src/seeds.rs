//! Inputs to start from: small fields of every combination of columns, as packages and as inputs
//! of the round trip.

use codec::{Coder, EncodeOptions, Field, Source, encode};

use crate::{
    common::{Shape, field, info, static_field},
    properties::{CODERS, Input},
};

/// Packages by all coders, with their names.
pub fn packages() -> Vec<(String, Vec<u8>)> {
    let info = info();
    let mut packages = Vec::new();
    for coder in CODERS {
        for (name, Input { field, layers, plate }) in inputs() {
            let plate = plate.then(|| static_field(3, field.sh_degree ^ 1, 3));
            let mut options = EncodeOptions { coder, ..EncodeOptions::default() };
            options.layers = layers;
            let source = Source { info: &info, field: &field, plate: plate.as_ref() };
            let package = encode(&source, &options).expect("the fields are valid");
            packages.push((format!("{}-{name}.aarc", coder.name()), package));
        }
    }
    // Equal Gaussians that cost this coder nothing to store, and enough of them for three chunks;
    // with view-dependent colours they pass the limit.
    for sh_degree in [0, 3] {
        let field = static_field(1, sh_degree, 2).select(&[0; 8193]);
        let source = Source { info: &info, field: &field, plate: None };
        let options = EncodeOptions { coder: Coder::Fixed, ..EncodeOptions::default() };
        let package = encode(&source, &options).expect("the fields are valid");
        packages.push((format!("flood-sh{sh_degree}.aarc"), package));
    }
    packages
}

/// Inputs of the round trip, with their names.
pub fn sources() -> Vec<(String, Vec<u8>)> {
    inputs().into_iter().map(|(name, input)| (name, input.to_bytes())).collect()
}

/// A field of each combination of columns; every other one with layers, every other one with a
/// plate.
fn inputs() -> Vec<(String, Input)> {
    let still = Input { field: static_field(7, 1, 1), layers: vec![2], plate: true };
    let mut inputs = vec![("static".to_owned(), still)];
    for sh_degree in 0..=3 {
        for motion_order in 0..=3 {
            for rotation_rates in [false, true] {
                let shape = Shape { rows: 9, sh_degree, motion_order, rotation_rates, some_static: true };
                let field: Field = field(shape, inputs.len() as u64);
                let layers = if (sh_degree + motion_order) % 2 == 0 { vec![2, 6] } else { Vec::new() };
                let plate = (sh_degree / 2 + motion_order) % 2 == 0;
                let rates = if rotation_rates { "-rates" } else { "" };
                let name = format!("sh{sh_degree}-motion{motion_order}{rates}");
                inputs.push((name, Input { field, layers, plate }));
            }
        }
    }
    inputs
}
