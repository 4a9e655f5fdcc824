//! Importers: fitted fields in the formats of other programs become [`codec::Field`]s.
//!
//! Each format has a file that turns bytes into unchecked rows of a field; `clean` then repairs or drops
//! rows that violate the field's invariants, and drops unused columns.

mod clean;
mod compressed_ply;
pub(crate) mod field_file;
mod imported;
mod inria;
mod ply;
mod sog;
mod spacetime;
mod splat;
pub(crate) mod splatv;
pub(crate) mod spz;

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use program::Fault;

pub use field_file::VERSION as FIELD_FILE_VERSION;
pub use imported::{Hints, Imported, Repairs};

/// The formats that [`import`] reads, for messages.
pub const FORMATS: &str = "PLY (3D Gaussian Splatting, Spacetime Gaussians lite, compressed, or this tool's own), \
                           .splatv, .spz, SOG (.sog, or meta.json with its images), .splat";

/// Reads a fitted field.
///
/// # Errors
/// [`Fault::Data`] that names the file and the problem: missing, empty, of an unknown format, truncated,
/// without a required property, or without a usable Gaussian.
pub fn import(path: &Path) -> anyhow::Result<Imported> {
    let read = || -> Result<Imported, String> {
        let mut imported = read(path)?;
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
fn read(path: &Path) -> Result<Imported, String> {
    let metadata = fs::metadata(path).map_err(|error| error.to_string())?;
    if metadata.is_dir() {
        return sog::read_folder(path, OsStr::new("meta.json"));
    }
    if !metadata.is_file() {
        return Err("not a file".into());
    }
    let bytes = fs::read(path).map_err(|error| error.to_string())?;
    let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
    match &bytes[..] {
        [] => Err("the file is empty".into()),
        // The only format without a magic number.
        _ if extension == "splat" => splat::read(&bytes),
        [b'p', b'l', b'y', b'\n' | b'\r', ..] => read_ply(&ply::Ply::parse(&bytes)?),
        [0x4b, 0x67, 0, 0, ..] => splatv::read(&bytes),
        [0x1f, 0x8b, ..] | [b'N', b'G', b'S', b'P', ..] => spz::read(&bytes),
        [b'P', b'K', 3, 4, ..] => sog::read_bundle(&bytes),
        _ if extension == "json" => {
            let folder = path.parent().unwrap_or(Path::new("."));
            sog::read_folder(folder, path.file_name().unwrap_or_default())
        }
        _ => Err(format!(
            "not a known format (starts with {}); a field is one of: {FORMATS}",
            bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
        )),
    }
}

fn read_ply(ply: &ply::Ply) -> Result<Imported, String> {
    let Some(vertex) = ply.table("vertex") else {
        return Err("PLY without a vertex element".into());
    };
    if field_file::is_marked(ply) {
        field_file::read(ply, vertex)
    } else if ply.table("chunk").is_some() {
        compressed_ply::read(ply, vertex)
    } else if vertex.has("trbf_center") {
        spacetime::read(vertex)
    } else {
        inria::read(vertex)
    }
}
