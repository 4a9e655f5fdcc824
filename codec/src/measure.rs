//! [`measure`]: where the bytes of a package go, and what simpler coding would make of the same
//! numbers.

use crate::{
    Coder, Error, Limits,
    context::{self, BitStats, Part},
    decode::{blank_field, complete_layers},
    header::contents,
    limits::Budget,
    rows::Rows,
};

/// Bytes of an attribute in all Gaussians of a package. What they were rounded to is the same in
/// all three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttributeSize {
    /// Name of the attribute.
    pub attribute: &'static str,
    /// If each number took what its frequency in the package asks for (order-0 entropy, without the
    /// tables that it would need), and the Gaussians came in an order of their own.
    pub order_0: f64,
    /// If the difference of each number from its prediction did, and the order were free.
    pub predicted: f64,
    /// As it is coded.
    pub coded: f64,
}

/// Attributes, and their parts in a chunk.
const ATTRIBUTES: [(&str, &[Part]); 10] = [
    ("position", &[Part::Cells, Part::Position]),
    ("visibility classes", &[Part::Classes]),
    ("opacity", &[Part::Opacity]),
    ("window", &[Part::Window]),
    ("scale", &[Part::Scales]),
    ("rotation", &[Part::Rotation]),
    ("motion", &[Part::Motion]),
    ("rotation rate", &[Part::Spin]),
    ("color", &[Part::Color]),
    ("spherical harmonics", &[Part::Harmonics]),
];

/// Sizes of the attributes in the complete layers of a package, the plate's included; those that no
/// Gaussian has are not listed, nor are any of the coder `fixed`, which mixes them. Takes some times
/// as long as decoding, and a few bytes more than the limits for each number.
///
/// # Errors
/// Those of [`decode`](crate::decode()).
pub fn measure(bytes: &[u8], limits: &Limits) -> Result<Vec<AttributeSize>, Error> {
    let contents = contents(bytes, limits)?;
    let complete = complete_layers(&contents, bytes.len())?;
    if contents.coder == Coder::Fixed {
        return Ok(Vec::new());
    }
    let mut tally = BitStats::default();
    for (planned, section) in contents.planned_sections() {
        if usize::from(planned.layer) == complete {
            break;
        }
        let columns = contents.columns(planned.region);
        let mut field = blank_field(columns, planned.rows, &mut Budget::new(limits))?;
        let payload = section.payload(bytes)?;
        context::decode_watched(payload, columns, section.offset, Rows::of(&mut field), &mut tally)?;
    }
    let size = |(attribute, parts): (&'static str, &[Part])| {
        let mut size = AttributeSize { attribute, order_0: 0.0, predicted: 0.0, coded: 0.0 };
        let mut is_there = false;
        for &part in parts {
            let Some(bits) = tally.bits(part) else { continue };
            is_there = true;
            size.order_0 += bits.order_0 / 8.0;
            // The free order is all there is to predict of a cell.
            size.predicted += if part == Part::Cells { bits.coded } else { bits.predicted } / 8.0;
            size.coded += bits.coded / 8.0;
        }
        is_there.then_some(size)
    };
    Ok(ATTRIBUTES.into_iter().filter_map(size).collect())
}
