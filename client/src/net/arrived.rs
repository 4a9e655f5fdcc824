//! [`Arrived`]: the bytes of a package that are here, and how much of it they are enough for; or those
//! of another file, which says nothing of itself.

use codec::{Error, FormatError, Limits, contents};

/// The beginning of a file.
#[derive(Debug)]
pub(super) struct Arrived {
    limits: Limits,
    /// Whether it is a package, which tells where it ends.
    is_package: bool,
    bytes: Vec<u8>,
    /// Where each layer ends, the last one, and the package, once the head is here.
    ends: Option<(Vec<usize>, usize)>,
}

impl Arrived {
    /// Of a package.
    pub(super) fn new(limits: Limits) -> Arrived {
        Arrived { limits, is_package: true, bytes: Vec::new(), ends: None }
    }

    /// Of any file, which ends when no more comes.
    pub(super) fn document(limits: Limits) -> Arrived {
        Arrived { is_package: false, ..Arrived::new(limits) }
    }

    /// Whether it ends when no more comes.
    pub(super) fn is_document(&self) -> bool {
        !self.is_package
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        (self.bytes, self.ends) = (Vec::new(), None);
    }

    /// Takes in the next bytes; of what follows the package, nothing.
    ///
    /// # Errors
    /// As soon as they cannot be the beginning of a package.
    pub(super) fn push(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.bytes.extend_from_slice(bytes);
        if self.is_package && self.ends.is_none() {
            let contents = match contents(&self.bytes, &self.limits) {
                Err(Error::Format { error: FormatError::Truncated { needed, .. }, .. }) => {
                    return self.is_allowed(needed);
                }
                Err(Error::Format { error: FormatError::Extra { .. }, offset }) => {
                    contents(&self.bytes[..offset], &self.limits)?
                }
                contents => contents?,
            };
            self.is_allowed(contents.package_bytes())?;
            self.ends = Some((contents.layer_bytes(), contents.package_bytes()));
        }
        if let Some((_, end)) = &self.ends {
            self.bytes.truncate(*end);
        }
        Ok(())
    }

    /// Whether a package may be so long.
    fn is_allowed(&self, needed: usize) -> Result<(), Error> {
        let limit = self.limits.max_bytes;
        if needed > limit {
            Err(Error::Limits { offset: 0, quantity: "bytes", needed, limit })
        } else {
            Ok(())
        }
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Bytes up to the end of the last layer that is complete; 0 before there is one.
    pub(super) fn playable(&self) -> usize {
        let Some((layers, _)) = &self.ends else { return 0 };
        layers.iter().rev().find(|&&end| end <= self.bytes.len()).map_or(0, |&end| end)
    }

    /// Bytes of the package, once its head is here.
    pub(super) fn package_bytes(&self) -> Option<usize> {
        self.ends.as_ref().map(|(_, end)| *end)
    }

    /// Whether all of it is here.
    pub(super) fn is_complete(&self) -> bool {
        self.package_bytes().is_some_and(|end| self.bytes.len() >= end)
    }

    /// All bytes.
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
            let mut arrived = Arrived::new(limits);
            for bytes in DEMO.chunks(piece) {
                arrived.push(bytes).unwrap();
                let here = arrived.bytes().len();
                let expected = ends.iter().copied().filter(|&end| end <= here).max().unwrap_or(0);
                assert_eq!(arrived.playable(), expected, "{here} bytes");
                assert_eq!(arrived.is_complete(), here == DEMO.len());
            }
            assert_eq!(arrived.take(), DEMO);
        }
    }

    #[test]
    fn what_follows_the_package_is_not_taken() {
        for piece in [1000, usize::MAX] {
            let mut arrived = Arrived::new(Limits::default());
            for bytes in [DEMO, b"more"].concat().chunks(piece) {
                arrived.push(bytes).unwrap();
            }
            assert_eq!(arrived.take(), DEMO);
        }
    }

    #[test]
    fn what_is_no_package_is_told_by_its_first_bytes() {
        let mut arrived = Arrived::new(Limits::default());
        assert!(arrived.push(b"<!doctype html>").is_err());
        arrived.clear();
        arrived.push(&DEMO[..4]).unwrap();
        assert!(arrived.push(&[9; 8]).is_err(), "another version");
        let few = Limits { max_gaussians: 10, ..Limits::default() };
        assert!(Arrived::new(few).push(&DEMO[..DEMO.len() / 2]).is_err(), "more than allowed");
        for bytes in [200, DEMO.len() - 1] {
            let short = Limits { max_bytes: bytes, ..Limits::default() };
            let error = Arrived::new(short).push(&DEMO[..1000]).unwrap_err();
            assert!(matches!(error, Error::Limits { .. }), "{bytes}: {error}");
        }
    }
}
