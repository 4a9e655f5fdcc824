//! Importers: fitted fields in the formats of other programs become [`codec::Field`]s.
//!
//! Each format has a file that turns bytes into unchecked rows of a field; `clean` then repairs or drops
//! rows that violate the field's invariants, and drops unused columns.

mod budget;
mod clean;
mod compressed_ply;
pub(crate) mod field_file;
mod fit_record;
mod imported;
mod inria;
mod ply;
mod probe;
mod sog;
mod spacetime;
mod splat;
pub(crate) mod splatv;
pub(crate) mod spz;

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use program::Fault;

use budget::ImportBudget;

use crate::messages::unreadable;

pub use budget::ImportLimits;
pub use field_file::VERSION as FIELD_FILE_VERSION;
pub use fit_record::FitRecord;
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
    let mut budget = ImportBudget::new(limits);
    let source = FieldSource::open(path, &mut budget)?;
    let read = |budget: &mut ImportBudget| -> Result<Imported, String> {
        let mut imported = source.read(budget)?;
        imported.check_complete()?;
        imported.field = clean::clean(imported.field, &mut imported.repairs);
        match imported.field.is_empty() {
            false => Ok(imported),
            true if imported.repairs.dropped.is_empty() => Err("no Gaussians".into()),
            true => Err(format!("no usable Gaussians: {}", imported.repairs)),
        }
    };
    Ok(read(&mut budget).map_err(|what| match budget.is_exceeded() {
        true => fault(path, what),
        false => fault(path, format!("{what}; get the file again, or export it again")),
    })?)
}

/// A file or folder, by its format.
enum FieldSource {
    /// The folder and the index of an unbundled SOG.
    Sog(PathBuf, OsString),
    SogBundle(Vec<u8>),
    Ply(Vec<u8>),
    Splat(Vec<u8>),
    Splatv(Vec<u8>),
    Spz(Vec<u8>),
}

impl FieldSource {
    /// Reads a file and detects its format.
    ///
    /// # Errors
    /// [`Fault::Data`] for a path at which no field can be.
    fn open(path: &Path, budget: &mut ImportBudget) -> Result<FieldSource, Fault> {
        const INDEX: &str = "meta.json";
        let metadata = fs::metadata(path).map_err(|error| unreadable(path, &error))?;
        if metadata.is_dir() {
            return match path.join(INDEX).exists() {
                true => Ok(FieldSource::Sog(path.into(), INDEX.into())),
                false => Err(fault(path, format!("a folder without {INDEX} is no field (SOG); name a file"))),
            };
        }
        let name = path.file_name().unwrap_or_default();
        if name == "lod-meta.json" {
            let what = format!("it lists several fields; name one of their folders, or its {INDEX}");
            return Err(fault(path, what));
        }
        if !metadata.is_file() {
            return Err(fault(path, format!("not a file; a field is one of: {FORMATS}")));
        }
        let bytes = budget.read_file(path).map_err(|what| fault(path, what))?;
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
        Ok(match &bytes[..] {
            [] => return Err(fault(path, "the file is empty; get it again, or export it again".into())),
            // The only format without a magic number.
            _ if extension == "splat" => FieldSource::Splat(bytes),
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => FieldSource::Ply(bytes),
            [0x4b, 0x67, 0, 0, ..] => FieldSource::Splatv(bytes),
            [0x1f, 0x8b, ..] | [b'N', b'G', b'S', b'P', ..] => FieldSource::Spz(bytes),
            [b'P', b'K', 3, 4, ..] => FieldSource::SogBundle(bytes),
            [b'A', b'A', b'R', b'C', ..] => {
                let what = "this is a package already; play it with `aarc`, or make a field of it with `export --ply`";
                return Err(fault(path, what.into()));
            }
            _ if extension == "json" => {
                FieldSource::Sog(path.parent().unwrap_or(Path::new(".")).into(), name.into())
            }
            _ => {
                let start: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
                let start = start.join(" ");
                let what = format!("not a known format (starts with {start}); a field is one of: {FORMATS}");
                return Err(fault(path, what));
            }
        })
    }

    /// Reads the rows unchecked: [`Imported::field`] may be invalid.
    fn read(&self, budget: &mut ImportBudget) -> Result<Imported, String> {
        match self {
            FieldSource::Sog(folder, index) => sog::read_folder(folder, index, budget),
            FieldSource::SogBundle(bytes) => sog::read_bundle(bytes, budget),
            FieldSource::Ply(bytes) => read_ply(&ply::Ply::parse(bytes, budget)?, budget),
            FieldSource::Splat(bytes) => splat::read(bytes, budget),
            FieldSource::Splatv(bytes) => splatv::read(bytes, budget),
            FieldSource::Spz(bytes) => spz::read(bytes, budget),
        }
    }
}

fn fault(path: &Path, what: String) -> Fault {
    Fault::Data(format!("{}: {what}", path.display()))
}

fn read_ply(ply: &ply::Ply, budget: &mut ImportBudget) -> Result<Imported, String> {
    let Some(vertex) = ply.table("vertex") else {
        return Err("PLY without a vertex element".into());
    };
    let (hints, filter) = (field_file::hints(ply)?, field_file::filter(ply)?);
    let mut imported = if field_file::is_marked(ply) {
        field_file::read(vertex, budget)
    } else if ply.table("chunk").is_some() {
        compressed_ply::read(ply, vertex, budget)
    } else if vertex.has("trbf_center") {
        spacetime::read(vertex, budget)
    } else {
        inria::read(vertex, budget)
    }?;
    imported.field.filter = filter;
    Ok(Imported { hints, ..imported })
}
