//! [`Limits`]: bounds on what decoding may produce, independent of the package.

use crate::{Error, format::COUNTS_OFFSET};

/// Bounds on what decoding may produce. Decoding beyond one fails with [`Error::Limits`] before
/// it allocates.
///
/// They bound what is in memory, not the length of the file: a clip, or the table of a take with one segment. A
/// player that holds several segments at once bounds their sum itself:
/// [`Take::resident_max`](crate::Take::resident_max)
/// is the largest number of Gaussians that an instant needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest number of Gaussians, the plate included.
    pub max_gaussians: usize,
    /// Largest number of bytes allocated at a time: the tables of sections and segments, the decoded clip and the
    /// decoder's work space.
    pub max_bytes: usize,
}

impl Default for Limits {
    /// 4 million Gaussians and 1 GiB: a hundred times a usual clip.
    fn default() -> Limits {
        Limits { max_gaussians: 4_000_000, max_bytes: 1 << 30 }
    }
}

/// Memory left to one decoding.
#[derive(Clone)]
pub(crate) struct Budget {
    limit: usize,
    left: usize,
}

impl Budget {
    pub(crate) fn new(limits: &Limits) -> Budget {
        Budget { limit: limits.max_bytes, left: limits.max_bytes }
    }

    /// Bytes left.
    pub(crate) fn left(&self) -> usize {
        self.left
    }

    /// Allocates an empty vector with room for `count` elements.
    ///
    /// # Errors
    /// [`Error::Limits`] if that exceeds the limit, or the system has no such memory.
    pub(crate) fn vec<T>(&mut self, count: usize) -> Result<Vec<T>, Error> {
        let bytes = count.saturating_mul(size_of::<T>());
        let before = self.left;
        self.spend(bytes)?;
        let mut vec = Vec::new();
        match vec.try_reserve_exact(count) {
            Ok(()) => Ok(vec),
            Err(_) => Err(self.exceeded(before, bytes)),
        }
    }

    /// Allocates a vector of `count` zeros.
    ///
    /// # Errors
    /// See [`Budget::vec`].
    pub(crate) fn zeros<T: Clone + Default>(&mut self, count: usize) -> Result<Vec<T>, Error> {
        let mut vec = self.vec(count)?;
        vec.resize(count, T::default());
        Ok(vec)
    }

    /// Counts memory that is allocated elsewhere.
    ///
    /// # Errors
    /// [`Error::Limits`] if that exceeds the limit.
    pub(crate) fn spend(&mut self, bytes: usize) -> Result<(), Error> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| self.exceeded(self.left, bytes))?;
        Ok(())
    }

    /// The error of requesting `bytes` with `left` bytes left.
    fn exceeded(&self, left: usize, bytes: usize) -> Error {
        let needed = (self.limit - left).saturating_add(bytes);
        Error::Limits { offset: COUNTS_OFFSET, quantity: "bytes of memory", needed, limit: self.limit }
    }
}
