//! [`Coder`]: the codings of Gaussians, by name and by number.

/// Coding of the Gaussians of a package.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coder {
    /// The paper's trajectory coding: FP16 and INT8 attributes, 10-bit motion coefficients, zstd.
    #[default]
    Fixed,
    /// Quantisation steps from the visibility of each Gaussian, and an adaptive rANS coder. Not in
    /// the paper.
    Rans,
}

impl Coder {
    /// All coders.
    pub const ALL: [Coder; 2] = [Coder::Fixed, Coder::Rans];

    /// Name on command lines and in reports: `fixed` or `rans`.
    pub fn name(self) -> &'static str {
        match self {
            Coder::Fixed => "fixed",
            Coder::Rans => "rans",
        }
    }

    /// Number in the head. Format.
    #[cfg(feature = "encode")]
    pub(crate) fn id(self) -> u8 {
        match self {
            Coder::Fixed => 1,
            Coder::Rans => 2,
        }
    }

    /// The coder of a number in the head.
    pub(crate) fn from_id(id: u8) -> Option<Coder> {
        match id {
            1 => Some(Coder::Fixed),
            2 => Some(Coder::Rans),
            _ => None,
        }
    }
}
