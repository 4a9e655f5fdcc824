//! [`measure`]: the bytes that each attribute takes, as coded and under simpler codings.

use crate::{
    Coder, Error, Limits,
    decode::complete_layers,
    gaussian,
    header::contents_within,
    limits::Budget,
    rans::{Attribute, BitStats},
    rows::Rows,
};

/// Bytes of an attribute in all Gaussians of a package, under three codings of the same quantised
/// numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttributeSize {
    /// Name of the attribute.
    pub attribute: &'static str,
    /// Order-0 entropy of the numbers in bytes, without tables, the order of the Gaussians included.
    pub order_0: f64,
    /// Order-0 entropy of the prediction residuals in bytes, without the order of the Gaussians.
    pub predicted: f64,
    /// Bytes as coded.
    pub coded: f64,
}

/// Names of the reported attributes, and the coded attributes that each sums.
const ATTRIBUTES: [(&str, &[Attribute]); 10] = [
    ("position", &[Attribute::Cells, Attribute::Position]),
    ("quantiser indices", &[Attribute::QuantiserIndices]),
    ("opacity", &[Attribute::Opacity]),
    ("window", &[Attribute::WindowWidth, Attribute::WindowCenter]),
    ("scale", &[Attribute::Scales]),
    ("rotation", &[Attribute::Rotation]),
    ("motion", &[Attribute::Motion]),
    ("rotation rate", &[Attribute::AngularRate]),
    ("color", &[Attribute::Color]),
    ("spherical harmonics", &[Attribute::Harmonics]),
];

/// Returns the size of each attribute in the complete layers of a package, the plate included.
///
/// Attributes that no Gaussian has are left out; the list is empty for the coder `fixed`, whose zstd
/// frames mix attributes. Takes several times as long as decoding, and a few bytes per number beyond
/// `limits`.
///
/// # Errors
/// See [`decode`](crate::decode()).
pub fn measure(bytes: &[u8], limits: &Limits) -> Result<Vec<AttributeSize>, Error> {
    let mut budget = Budget::new(limits);
    let contents = contents_within(bytes, limits, &mut budget)?;
    let complete = complete_layers(&contents, 0, bytes.len())?;
    let mut stats = BitStats::default();
    for (planned, section) in contents.planned_sections() {
        if usize::from(planned.layer) == complete {
            break;
        }
        let columns = contents.columns().in_region(planned.region);
        let mut field = columns.zeros(planned.rows, &mut budget.clone())?;
        let payload = section.payload(bytes)?;
        let rows = Rows::all(&mut field);
        match contents.coder {
            Coder::Fixed => return Ok(Vec::new()),
            Coder::Rans => gaussian::decode_observed(payload, columns, section.offset, rows, &mut stats)?,
        }
    }
    let size = |(name, attributes): (&'static str, &[Attribute])| {
        let mut size = AttributeSize { attribute: name, order_0: 0.0, predicted: 0.0, coded: 0.0 };
        let mut is_present = false;
        for &attribute in attributes {
            let Some(bits) = stats.bits(attribute) else { continue };
            is_present = true;
            size.order_0 += bits.order_0 / 8.0;
            // Of a cell only the order is predicted.
            size.predicted += if attribute == Attribute::Cells { bits.coded } else { bits.predicted } / 8.0;
            size.coded += bits.coded / 8.0;
        }
        is_present.then_some(size)
    };
    Ok(ATTRIBUTES.into_iter().filter_map(size).collect())
}
