//! Importers: fitted fields in the formats of other programs become [`codec::Field`]s.
//!
//! Each format has a file that turns bytes into unchecked rows of a field; `clean` then repairs or drops
//! rows that violate the field's invariants, and drops unused columns.

mod budget;
mod clean;
mod compressed_ply;
pub(crate) mod field_file;
mod imported;
mod inria;
mod ply;
mod probe;
mod sog;
mod spacetime;
mod splat;
pub(crate) mod splatv;
pub(crate) mod spz;

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use program::Fault;

use budget::ImportBudget;

pub use budget::ImportLimits;
pub use field_file::VERSION as FIELD_FILE_VERSION;
pub use imported::{Hints, Imported, Repairs};

/// The formats that [`import`] reads, for messages.
pub const FORMATS: &str = "PLY (3D Gaussian Splatting, Spacetime Gaussians lite, compressed, or this tool's own), \
                           .splatv, .spz, SOG (.sog, or meta.json with its images), .splat";

/// Reads a fitted field within the default limits.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem: missing, empty, of an unknown format, truncated to less
/// than half, without a required property, without a usable Gaussian, or beyond the limits.
pub fn import(path: &Path) -> anyhow::Result<Imported> {
    import_within(path, ImportLimits::default())
}

/// Reads a fitted field as [`import`] does, within `limits`.
///
/// # Errors
/// Those of [`import`].
pub fn import_within(path: &Path, limits: ImportLimits) -> anyhow::Result<Imported> {
    let read = || -> Result<Imported, String> {
        let mut budget = ImportBudget::new(limits);
        let mut imported = read(path, &mut budget)?;
        imported.check_complete()?;
        imported.field = clean::clean(imported.field, &mut imported.repairs);
        if imported.field.is_empty() {
            return Err(match imported.repairs.dropped.is_empty() {
                true => "no Gaussians".into(),
                false => format!("no usable Gaussians: {}", imported.repairs),
            });
        }
        Ok(imported)
    };
    read().map_err(|what| Fault::Data(format!("{}: {what}", path.display())).into())
}

/// Reads the rows of a file unchecked: [`Imported::field`] may be invalid.
fn read(path: &Path, budget: &mut ImportBudget) -> Result<Imported, String> {
    if fs::metadata(path).is_ok_and(|metadata| metadata.is_dir()) {
        return sog::read_folder(path, OsStr::new("meta.json"), budget);
    }
    let bytes = budget.read_file(path)?;
    let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
    match &bytes[..] {
        [] => Err("the file is empty".into()),
        // The only format without a magic number.
        _ if extension == "splat" => splat::read(&bytes, budget),
        [b'p', b'l', b'y', b'\n' | b'\r', ..] => read_ply(&ply::Ply::parse(&bytes, budget)?, budget),
        [0x4b, 0x67, 0, 0, ..] => splatv::read(&bytes, budget),
        [0x1f, 0x8b, ..] | [b'N', b'G', b'S', b'P', ..] => spz::read(&bytes, budget),
        [b'P', b'K', 3, 4, ..] => sog::read_bundle(&bytes, budget),
        _ if extension == "json" => {
            let folder = path.parent().unwrap_or(Path::new("."));
            sog::read_folder(folder, path.file_name().unwrap_or_default(), budget)
        }
        _ => Err(format!(
            "not a known format (starts with {}); a field is one of: {FORMATS}",
            bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
        )),
    }
}

fn read_ply(ply: &ply::Ply, budget: &mut ImportBudget) -> Result<Imported, String> {
    let Some(vertex) = ply.table("vertex") else {
        return Err("PLY without a vertex element".into());
    };
    let hints = field_file::hints(ply)?;
    let imported = if field_file::is_marked(ply) {
        field_file::read(vertex, budget)
    } else if ply.table("chunk").is_some() {
        compressed_ply::read(ply, vertex, budget)
    } else if vertex.has("trbf_center") {
        spacetime::read(vertex, budget)
    } else {
        inria::read(vertex, budget)
    };
    Ok(Imported { hints, ..imported? })
}
