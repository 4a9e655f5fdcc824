//! [`Target`]: as what a field is written, and what each holds.

use codec::{ClipInfo, Field};

use crate::{glb, ply, splatv, spz};

/// As what a field is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// This project's lossless field file.
    FieldFile,
    /// A static PLY of 3D Gaussian Splatting; also the frames of a sequence ([`crate::SequenceFrames`]).
    StaticPly,
    /// A `.splatv`.
    Splatv,
    /// An `.spz`.
    Spz,
    /// A `.glb`.
    Glb,
}

impl Target {
    /// Every target, in the order of the table of formats.
    #[cfg(test)]
    pub(crate) const ALL: [Target; 5] =
        [Target::FieldFile, Target::StaticPly, Target::Splatv, Target::Spz, Target::Glb];

    /// Whether it holds windows and motion. Of one that does not, [`crate::frozen()`] gives an instant.
    pub fn holds_motion(self) -> bool {
        match self {
            Target::FieldFile | Target::Splatv => true,
            Target::StaticPly | Target::Spz | Target::Glb => false,
        }
    }

    /// What it does not hold of a field and the metadata of its clip.
    pub fn lost(self, field: &Field, info: &ClipInfo) -> Vec<&'static str> {
        match self {
            Target::FieldFile => Vec::new(),
            Target::StaticPly => ply::lost(field),
            Target::Splatv => splatv::lost(field),
            Target::Spz => spz::lost(field, info),
            Target::Glb => glb::lost(field, info),
        }
    }

    /// The bytes of the file of a field, with the metadata of its clip and, in a field file, further `comments`.
    ///
    /// # Errors
    /// One sentence: a field beyond the size of the format.
    pub fn write(
        self,
        field: &Field,
        info: &ClipInfo,
        comments: &[(&str, String)],
    ) -> Result<Vec<u8>, String> {
        Ok(match self {
            Target::FieldFile => ply::write_commented_field_file(field, info, comments),
            Target::StaticPly => ply::write_static_ply(field, Some(info)),
            Target::Splatv => splatv::write(field, info),
            Target::Spz => spz::write(field, info.up),
            Target::Glb => glb::write(field, info)
                .ok_or("a GLB holds at most 4 GiB: package it with a --budget before")?,
        })
    }
}
