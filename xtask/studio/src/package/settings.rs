//! [`PackageSettings`]: budget, ranking and coding of a package.

use clap::ValueEnum;
use codec::Coder;
use refine::code::JOINT_ROUNDS;
use refine::prune::Ranking;

/// Settings of packaging.
#[derive(Clone, Debug, Default)]
pub struct PackageSettings {
    /// Most Gaussians to keep, the plate's not counted; `None` keeps all that can be seen.
    pub budget: Option<usize>,
    /// The ranking that decides what a budget keeps; `None` tries all and takes the best.
    pub rank: Option<Ranking>,
    /// Prune by the ranking alone, without the topology floor.
    pub no_floor: bool,
    /// Most fragments to keep, as a fraction of the fragments of the retained Gaussians; `None` keeps all.
    pub fragments: Option<f64>,
    /// Fit the colours of the retained Gaussians to pictures of the whole field.
    pub recolor: bool,
    /// How the Gaussians are coded.
    pub coding: Coding,
    /// Parts to remove.
    pub drop: Vec<DropPart>,
    /// Refuse a scene whose files needed repairs.
    pub strict: bool,
}

/// A part of a field that a package can do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DropPart {
    /// Rotation over time.
    Angular,
    /// View-dependent colour.
    Sh,
    /// The static background.
    Plate,
    /// Gaussians that are seen from nowhere people stand.
    Unseen,
}

/// Numbers of Gaussians at which layers end; the last layer ends at the last Gaussian.
pub const LAYERS: [usize; 5] = [5_000, 10_000, 20_000, 40_000, 80_000];

/// Default of [`Coding::ToQuality::quality_db`]: coding then costs 0.01 dB of a field that fits its
/// photographs to 24.3 dB.
pub const QUALITY_DB: f64 = 50.7;

/// How Gaussians are coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    /// By the coder `fixed`, with the paper's numbers of bits.
    Fixed,
    /// By the coder `rans`, as coarsely as a PSNR allows.
    ToQuality {
        /// Target PSNR in dB against the field before coding.
        quality_db: f64,
        /// Number of rounds in which numbers are rounded jointly; 0 rounds each alone.
        joint_rounds: usize,
    },
}

impl Default for Coding {
    fn default() -> Coding {
        Coding::ToQuality { quality_db: QUALITY_DB, joint_rounds: JOINT_ROUNDS }
    }
}

impl Coding {
    pub(crate) fn coder(self) -> Coder {
        match self {
            Coding::Fixed => Coder::Fixed,
            Coding::ToQuality { .. } => Coder::Rans,
        }
    }

    /// Target PSNR in dB; `None` for a coder of one precision.
    pub(super) fn quality_db(self) -> Option<f64> {
        match self {
            Coding::Fixed => None,
            Coding::ToQuality { quality_db, .. } => Some(quality_db),
        }
    }

    /// Name of the coder.
    pub(crate) fn name(self) -> &'static str {
        self.coder().name()
    }
}
