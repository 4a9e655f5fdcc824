//! [`PartialFile`]: the bytes of a file received so far, and how many of them play if it is a package.

use codec::{Error, FormatError, Limits, contents};

/// The beginning of a file.
#[derive(Debug)]
pub(super) struct PartialFile {
    limits: Limits,
    /// A package, whose head says where it ends.
    is_package: bool,
    bytes: Vec<u8>,
    /// The ends of the layers and of the package, once its head is complete.
    ends: Option<(Vec<usize>, usize)>,
}

impl PartialFile {
    /// An empty beginning of a package.
    pub(super) fn package(limits: Limits) -> PartialFile {
        PartialFile { limits, is_package: true, bytes: Vec::new(), ends: None }
    }

    /// An empty beginning of a file of any other kind, which ends where the server ends it.
    pub(super) fn document(limits: Limits) -> PartialFile {
        PartialFile { is_package: false, ..PartialFile::package(limits) }
    }

    /// Whether only the server knows where the file ends.
    pub(super) fn is_document(&self) -> bool {
        !self.is_package
    }

    /// Whether it begins as HTML does, which neither packages nor playlists do.
    pub(super) fn is_web_page(&self) -> bool {
        let bytes = self.bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.bytes);
        bytes.trim_ascii_start().starts_with(b"<")
    }

    /// Discards all bytes.
    pub(super) fn clear(&mut self) {
        (self.bytes, self.ends) = (Vec::new(), None);
    }

    /// Appends the next bytes, without those beyond the end of the package.
    ///
    /// # Errors
    /// As soon as the bytes cannot be the beginning of a package within the limits.
    pub(super) fn push(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.bytes.extend_from_slice(bytes);
        if self.is_package && self.ends.is_none() {
            let contents = match contents(&self.bytes, &self.limits) {
                Err(Error::Format { error: FormatError::Truncated { needed, .. }, .. }) => {
                    return self.check_length(needed);
                }
                Err(Error::Format { error: FormatError::Extra { .. }, offset }) => {
                    contents(&self.bytes[..offset], &self.limits)?
                }
                contents => contents?,
            };
            self.check_length(contents.package_bytes())?;
            self.ends = Some((contents.layer_bytes(), contents.package_bytes()));
        }
        if let Some((_, end)) = &self.ends {
            self.bytes.truncate(*end);
        }
        Ok(())
    }

    fn check_length(&self, needed: usize) -> Result<(), Error> {
        let limit = self.limits.max_bytes;
        if needed > limit {
            Err(Error::Limits { offset: 0, quantity: "bytes", needed, limit })
        } else {
            Ok(())
        }
    }

    /// The bytes received so far.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Bytes up to the end of the last complete layer; 0 before the first is complete.
    pub(super) fn playable_bytes(&self) -> usize {
        let Some((layers, _)) = &self.ends else { return 0 };
        layers.iter().rev().find(|&&end| end <= self.bytes.len()).map_or(0, |&end| end)
    }

    /// Bytes of the complete package, once its head is complete.
    pub(super) fn package_bytes(&self) -> Option<usize> {
        self.ends.as_ref().map(|(_, end)| *end)
    }

    /// Whether the package is complete.
    pub(super) fn is_complete(&self) -> bool {
        self.package_bytes().is_some_and(|end| self.bytes.len() >= end)
    }

    /// Moves the bytes out.
    pub(super) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEMO: &[u8] = include_bytes!("../../../assets/demo.aarc");

    #[test]
    fn layers_become_playable_one_after_the_other() {
        let limits = Limits::default();
        let ends = contents(DEMO, &limits).unwrap().layer_bytes();
        assert!(ends.len() > 1 && ends.last() == Some(&DEMO.len()), "{ends:?}");
        for piece in [1, 1000, 65_536] {
            let mut file = PartialFile::package(limits);
            for bytes in DEMO.chunks(piece) {
                file.push(bytes).unwrap();
                let received = file.bytes().len();
                let expected = ends.iter().copied().filter(|&end| end <= received).max().unwrap_or(0);
                assert_eq!(file.playable_bytes(), expected, "{received} bytes");
                assert_eq!(file.is_complete(), received == DEMO.len());
            }
            assert_eq!(file.take(), DEMO);
        }
    }

    #[test]
    fn bytes_beyond_the_package_are_dropped() {
        for piece in [1000, usize::MAX] {
            let mut file = PartialFile::package(Limits::default());
            for bytes in [DEMO, b"more"].concat().chunks(piece) {
                file.push(bytes).unwrap();
            }
            assert_eq!(file.take(), DEMO);
        }
    }

    #[test]
    fn the_first_bytes_tell_that_a_file_is_no_package() {
        let mut file = PartialFile::package(Limits::default());
        assert!(file.push(b"<!doctype html>").is_err());
        assert!(file.is_web_page());
        file.clear();
        file.push(&DEMO[..4]).unwrap();
        assert!(!file.is_web_page());
        assert!(file.push(&[9; 8]).is_err(), "another version");
        let few = Limits { max_gaussians: 10, ..Limits::default() };
        assert!(PartialFile::package(few).push(&DEMO[..DEMO.len() / 2]).is_err(), "more than allowed");
        for bytes in [200, DEMO.len() - 1] {
            let short = Limits { max_bytes: bytes, ..Limits::default() };
            let error = PartialFile::package(short).push(&DEMO[..1000]).unwrap_err();
            assert!(matches!(error, Error::Limits { .. }), "{bytes}: {error}");
        }
    }
}
