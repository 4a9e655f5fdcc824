//! Importers: fitted fields in the formats of other programs become [`codec::Field`]s.
//!
//! Each format has a file that turns bytes into unchecked rows of a field; `clean` then repairs or drops
//! rows that violate the field's invariants, and drops unused columns.

mod clean;
mod compressed_ply;
pub(crate) mod field_file;
mod inria;
mod ply;
mod sog;
mod spacetime;
mod splat;
pub(crate) mod splatv;
pub(crate) mod spz;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fmt;
use std::fs;
use std::path::Path;

use codec::{Field, SH_C0, Viewpoint};
use program::Fault;
use refine::capture::Holdout;

pub use field_file::VERSION as FIELD_FILE_VERSION;

/// The formats that [`import`] reads, for messages.
pub const FORMATS: &str = "PLY (3D Gaussian Splatting, Spacetime Gaussians lite, compressed, or this tool's own), \
                           .splatv, .spz, SOG (.sog, or meta.json with its images), .splat";

/// Most Gaussians accepted from a compressed file, whose size does not bound their number.
const GAUSSIANS_MAX: usize = 1 << 24;

/// A field read from a file.
#[derive(Debug)]
pub struct Imported {
    /// The field, valid ([`Field::check`]) and with at least one Gaussian.
    pub field: Field,
    /// Metadata of the clip.
    pub hints: Hints,
    /// Changes made to satisfy the field's invariants.
    pub repairs: Repairs,
    /// Name of the file's format.
    pub format: &'static str,
}

/// Metadata of the clip that the file states or its format implies; `None` if neither does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hints {
    /// Unit vector of the source's axes that points up.
    pub up: Option<[f32; 3]>,
    /// Metres per unit of the source.
    pub metres_per_unit: Option<f32>,
    /// Length of the clip in seconds.
    pub duration_s: Option<f32>,
    /// Captured frames per second.
    pub fps: Option<f32>,
    /// Suggested viewpoints, the initial one first.
    pub viewpoints: Vec<Viewpoint>,
    /// Frames that were held out from fitting.
    pub holdout: Option<Holdout>,
}

/// Rows repaired or dropped on import, counted by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Reason to number of repaired rows.
    pub repaired: BTreeMap<&'static str, usize>,
    /// Reason to number of dropped rows.
    pub dropped: BTreeMap<&'static str, usize>,
}

impl Repairs {
    /// Whether no row was changed.
    pub fn is_empty(&self) -> bool {
        self.repaired.is_empty() && self.dropped.is_empty()
    }

    fn repair_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.repaired.entry(reason).or_default() += rows;
        }
    }

    fn drop_rows(&mut self, reason: &'static str, rows: usize) {
        if rows > 0 {
            *self.dropped.entry(reason).or_default() += rows;
        }
    }
}

/// One line, such as `repaired 3 (zero quaternion: 3), dropped 1 (non-finite centre: 1)`, or
/// `nothing to repair`.
impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = |verb: &str, counts: &BTreeMap<&'static str, usize>| {
            let reasons: Vec<String> = counts.iter().map(|(reason, n)| format!("{reason}: {n}")).collect();
            (!counts.is_empty())
                .then(|| format!("{verb} {} ({})", counts.values().sum::<usize>(), reasons.join(", ")))
        };
        let parts: Vec<String> = [part("repaired", &self.repaired), part("dropped", &self.dropped)]
            .into_iter()
            .flatten()
            .collect();
        f.write_str(if parts.is_empty() { "nothing to repair" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

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

/// The constant SH coefficient of a channel with this value in `[0, 1]`.
fn sh_of_rgb(value: f64) -> f32 {
    ((value - 0.5) / SH_C0) as f32
}

/// The logarithms of standard deviations. Zero, the result of underflow in formats with few bits,
/// becomes the smallest positive [`half::f16`].
fn log_of_scales(scales: [f32; 3], repairs: &mut Repairs) -> [f32; 3] {
    repairs.repair_rows("zero scale", usize::from(scales.contains(&0.0)));
    scales.map(|scale| if scale == 0.0 { half::f16::from_bits(1).to_f32() } else { scale }.ln())
}
