//! [`with_extra`]: gives a clip package another section that is not critical, such as sound or a poster. Gaussians are
//! copied, not coded anew.

use crate::{Contents, EncodeError, Error, FormatError, Region, Section, SectionKind};

/// Returns the clip package whose head is `contents`, with `payload` as its section of `kind`, or without such a section.
/// All other sections stay as they are. Sections that are not critical stand before all chunks, by their kinds.
///
/// # Errors
/// - [`EncodeError::Package`] if `package` is not whole.
/// - [`EncodeError::TooLarge`] if the result would exceed 4 GiB.
pub(crate) fn with_extra(
    package: &[u8],
    mut contents: Contents,
    kind: SectionKind,
    payload: Option<&[u8]>,
) -> Result<Vec<u8>, EncodeError> {
    let mut parts: Vec<(Section, &[u8])> = Vec::new();
    for section in contents.sections.iter().filter(|section| section.kind != kind) {
        let bytes = package.get(section.offset..section.end());
        parts.push((*section, bytes.ok_or_else(|| truncated(section.end(), package.len()))?));
    }
    if let Some(payload) = payload {
        let section = Section {
            kind,
            critical: false,
            layer: 0,
            region: Region::Static,
            chunk: 0,
            // `Contents::write` computes it from the lengths.
            offset: 0,
            length: payload.len(),
            raw_length: payload.len(),
            crc: crc32fast::hash(payload),
        };
        // Sound is the first section.
        let is_behind_sound = parts.first().is_some_and(|(first, _)| first.kind == SectionKind::Sound);
        parts.insert(usize::from(is_behind_sound), (section, payload));
    }
    contents.sections = parts.iter().map(|(section, _)| *section).collect();
    let mut written = contents.write()?;
    parts.iter().for_each(|(_, bytes)| written.extend_from_slice(bytes));
    Ok(written)
}

/// The error of a package that ends before `needed` bytes.
pub(crate) fn truncated(needed: usize, available: usize) -> EncodeError {
    EncodeError::Package(Error::format(available, FormatError::Truncated { needed, available }))
}
