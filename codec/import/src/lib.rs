//! Importers: fitted fields in the formats of other programs become [`codec::Field`]s.
//!
//! Each format has a file that turns bytes into unchecked rows of a field; `clean` then repairs or drops
//! rows that violate the field's invariants, and drops unused columns. `sequence` makes one moving field of a folder of
//! static ones. `scene` adds the background and the metadata of a clip. The host tool and the player read the same files by this crate, which depends on `codec` alone.

#![forbid(unsafe_code)]

mod budget;
mod clean;
mod compressed_ply;
mod error;
pub mod field_file;
mod folder;
mod freetime;
mod glb;
mod imported;
mod inria;
mod ksplat;
mod overrides;
mod padding;
mod ply;
mod probe;
mod scene;
mod sequence;
mod similarity;
mod sog;
mod source;
mod spacetime;
mod splat;
pub mod splatv;
pub mod spz;
mod up_axis;

use std::path::Path;

use budget::ImportBudget;
use source::FieldSource;

pub use budget::ImportLimits;
pub use error::ImportError;
pub use field_file::VERSION as FIELD_FILE_VERSION;
pub use folder::{FieldPath, NoField, POINT_CLOUDS, is_field_file, is_field_name, list_folder};
pub use glb::{EXTENSION as GAUSSIANS_EXTENSION, PREFIX as GAUSSIANS_PREFIX};
pub use imported::{Hints, Imported, Repairs};
pub use overrides::Overrides;
pub use scene::{
    DEFAULT_DURATION_S, DEFAULT_FPS, DEFAULT_METRES_PER_UNIT, ImportedScene, SceneFiles, import_plate,
    plate_path,
};
pub use sequence::{SequenceFiles, import_sequence};
pub use similarity::Similarity;
pub use source::{EXTENSIONS, FORMATS};
pub use up_axis::{DEFAULT_UP, up_of};

/// Reads a fitted field within the default limits.
///
/// # Errors
/// [`ImportError`] that names the file and the problem: missing, empty, of an unknown format, truncated to less
/// than half, without a required property, without a usable Gaussian, or beyond the limits.
pub fn import(path: &Path) -> Result<Imported, ImportError> {
    import_within(path, ImportLimits::default())
}

/// Reads a fitted field as [`import`] does, within `limits`.
///
/// # Errors
/// Those of [`import`].
pub fn import_within(path: &Path, limits: ImportLimits) -> Result<Imported, ImportError> {
    let mut budget = ImportBudget::new(limits);
    let imported = FieldSource::open(path, &mut budget)?.read_clean(path, &mut budget)?;
    match imported.field.is_empty() {
        false => Ok(imported.with_near()),
        true => Err(ImportError::new(path, imported.no_gaussians())),
    }
}
