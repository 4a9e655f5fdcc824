//! The one table of the formats: how files of each are recognised, and as what a field is written in it.

use std::ffi::OsStr;
use std::path::Path;

use codec::MAGIC;

use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::statements::Statement;
use crate::writing::Target;
use crate::{glb, ksplat, ply, sog, splat, splatv, spz};

/// Reads the rows of a file, unchecked. Further files are in the folder.
pub(crate) type Reader = fn(&[u8], &Path, &mut ImportBudget) -> Result<Imported, String>;

/// A format of fields. All are read.
pub struct Format {
    /// What messages call it.
    pub title: &'static str,
    /// Extensions of its files, in lower case; none for a folder.
    pub extensions: &'static [&'static str],
    /// As what fields are written in it; nothing if they are not.
    pub targets: &'static [Target],
    /// First bytes of its files, any of these.
    starts: &'static [&'static [u8]],
    /// Extension of its files that begin otherwise.
    other: Option<&'static str>,
    /// What its files can say.
    pub statements: &'static [Statement],
    pub(crate) read: Reader,
}

/// The formats.
pub const FORMATS: [Format; 8] = [
    Format {
        title: "PLY (3D Gaussian Splatting, Spacetime Gaussians lite, 4DGS, FreeTimeGS, compressed, or this tool's own)",
        extensions: &["ply"],
        targets: &[Target::FieldFile, Target::StaticPly],
        starts: &ply::STARTS,
        other: None,
        statements: ply::STATEMENTS,
        read: |bytes, _, budget| ply::read(bytes, budget),
    },
    Format {
        title: "a folder of numbered fields",
        extensions: &[],
        targets: &[Target::StaticPly],
        starts: &[],
        other: None,
        statements: &[],
        read: |bytes, _, budget| ply::read(bytes, budget),
    },
    Format {
        title: ".splatv",
        extensions: &["splatv"],
        targets: &[Target::Splatv],
        starts: &[&splatv::START],
        other: None,
        statements: splatv::STATEMENTS,
        read: |bytes, _, budget| splatv::read(bytes, budget),
    },
    Format {
        title: ".spz",
        extensions: &["spz"],
        targets: &[Target::Spz],
        starts: &spz::STARTS,
        other: None,
        statements: spz::STATEMENTS,
        read: |bytes, _, budget| spz::read(bytes, budget),
    },
    Format {
        title: "SOG (.sog, or meta.json with its images)",
        extensions: &["sog"],
        targets: &[],
        starts: &[sog::START],
        other: Some("json"),
        statements: sog::STATEMENTS,
        read: sog::read,
    },
    Format {
        title: ".glb and .gltf with KHR_gaussian_splatting",
        extensions: &["glb", "gltf"],
        targets: &[Target::Glb],
        starts: &[&glb::START],
        other: Some("gltf"),
        statements: glb::STATEMENTS,
        read: glb::read,
    },
    Format {
        title: ".splat",
        extensions: &["splat"],
        targets: &[],
        starts: &[],
        other: Some("splat"),
        statements: splat::STATEMENTS,
        read: |bytes, _, budget| splat::read(bytes, budget),
    },
    Format {
        title: ".ksplat",
        extensions: &["ksplat"],
        targets: &[],
        starts: &[],
        other: Some("ksplat"),
        statements: ksplat::STATEMENTS,
        read: |bytes, _, budget| ksplat::read(bytes, budget),
    },
];

impl Format {
    /// Whether its files are binary and do not begin alike, so that any file of that name may be taken for one.
    pub(crate) fn is_binary_without_start(&self) -> bool {
        self.starts.is_empty()
    }

    /// The format of a file with this content and this extension, in lower case.
    pub(crate) fn detect(bytes: &[u8], extension: &str) -> Option<&'static Format> {
        let is_other = |format: &&Format| format.other == Some(extension);
        // A format without first bytes may begin as another one does.
        let silent = FORMATS.iter().filter(|format| format.starts.is_empty()).find(is_other);
        let starts = |format: &&Format| format.starts.iter().any(|start| bytes.starts_with(start));
        let started = silent.or_else(|| FORMATS.iter().find(starts));
        // A package is no field, whatever its name.
        let named = || FORMATS.iter().find(is_other).filter(|_| !bytes.starts_with(&MAGIC));
        started.or_else(named)
    }
}

/// The formats, for messages.
pub fn titles() -> String {
    FORMATS.map(|format| format.title).join(", ")
}

/// Extensions of field files, in lower case. An unbundled SOG is a `meta.json` besides.
pub fn extensions() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.extensions).copied()
}

/// The extension of a path in lower case; empty if there is none.
pub(crate) fn extension_of(path: &Path) -> String {
    path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use codec::{ClipInfo, Field};

    use super::*;

    #[test]
    fn what_is_written_is_recognised() {
        let field = Field {
            centers: vec![[0.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[0.0; 3]],
            opacities: vec![0.5],
            sh: vec![[0.0; 3]],
            ..Field::default()
        };
        let files = FORMATS.iter().filter(|format| !format.extensions.is_empty());
        let written: Vec<(&str, Target)> =
            files.flat_map(|format| format.targets.iter().map(|&target| (format.title, target))).collect();
        for &(title, target) in &written {
            let bytes = target.write(&field, &ClipInfo::default(), &[]).unwrap();
            assert_eq!(Format::detect(&bytes, "").map(|format| format.title), Some(title), "{target:?}");
        }
        assert!(written.iter().map(|(_, target)| *target).eq(Target::ALL), "each has a row");
    }
}
