//! Formats of other programs: readers that turn their files into [`codec::Field`]s, and writers that turn fields into
//! such files.
//!
//! A format has a file, or a folder where it is large, with what it reads and what it writes; `table` lists the formats.
//! A reader turns bytes into unchecked rows of a field; `clean` then repairs or drops rows that violate the field's
//! invariants, and drops unused columns. `sequence` makes one moving field of a folder of static ones. `scene` adds the
//! background and the metadata of a clip. A writer turns a field into the bytes of a file. [`Account`] says what reading
//! repaired, assumed and lost, [`Target::lost`] what writing loses. The host tool and the player read the same files by this
//! crate, which depends on `codec` alone.

#![forbid(unsafe_code)]

mod account;
mod bytes;
mod clean;
mod columns;
mod deformation;
mod error;
mod folder;
mod frozen;
mod glb;
mod imported;
mod ksplat;
mod limits;
mod origin;
mod overrides;
mod ply;
mod scene;
mod sequence;
mod similarity;
mod sog;
mod source;
mod splat;
mod splatv;
mod spz;
mod statements;
mod table;
mod text;
mod up_axis;
mod writing;

use std::path::Path;

use limits::ImportBudget;
use source::FieldSource;

pub use account::{Account, Repairs};
pub use error::ImportError;
pub use folder::{
    FieldPath, NoField, POINT_CLOUDS, has_field, is_field_file, is_field_name, is_package, list_folder,
};
pub use frozen::frozen;
pub use glb::write as write_glb;
pub use imported::{Hints, Imported};
pub use limits::ImportLimits;
pub use overrides::Overrides;
pub use ply::{FIELD_FILE_VERSION, MARK, write_commented_field_file, write_field_file, write_static_ply};
pub use scene::{
    DEFAULT_DURATION_S, DEFAULT_FPS, DEFAULT_METRES_PER_UNIT, ImportedScene, SceneFiles, import_plate,
    plate_path,
};
pub use sequence::{SequenceFiles, SequenceFrames, import_sequence};
pub use similarity::Similarity;
pub use sog::INDEX as SOG_INDEX;
pub use splatv::write as write_splatv;
pub use spz::write as write_spz;
pub use statements::{Statement, Treatment, list_of};
pub use table::{FORMATS, Format, extensions, titles};
pub use text::is_lfs_pointer;
pub use up_axis::{DEFAULT_UP, up_of};
pub use writing::Target;

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
/// As [`import`] has them.
pub fn import_within(path: &Path, limits: ImportLimits) -> Result<Imported, ImportError> {
    let mut budget = ImportBudget::new(limits);
    let imported = FieldSource::open(path, &mut budget)?.read_clean(path, &mut budget)?;
    match imported.field.is_empty() {
        false => Ok(imported.with_near()),
        true => Err(ImportError::new(path, imported.no_gaussians())),
    }
}
