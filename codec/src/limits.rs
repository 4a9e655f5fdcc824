//! [`Limits`]: how much a package may ask of its reader, whatever it says of itself.

use crate::{Error, header::COUNTS_OFFSET};

/// Bounds on what decoding may produce.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Gaussians, those of the plate included.
    pub max_gaussians: usize,
    /// Bytes of memory allocated on behalf of the package: the decoded clip and the work space.
    pub max_bytes: usize,
}

impl Default for Limits {
    /// 4 million Gaussians, 1 GiB: a hundred times a usual clip.
    fn default() -> Limits {
        Limits { max_gaussians: 4_000_000, max_bytes: 1 << 30 }
    }
}

/// Memory not yet given out during one decoding.
pub(crate) struct Budget {
    limit: usize,
    left: usize,
}

impl Budget {
    pub(crate) fn new(limits: &Limits) -> Budget {
        Budget { limit: limits.max_bytes, left: limits.max_bytes }
    }

    /// An empty vector with room for `count` elements.
    ///
    /// # Errors
    /// [`Error::Limits`] where that passes the limit or the system has no such memory.
    pub(crate) fn vec<T>(&mut self, count: usize) -> Result<Vec<T>, Error> {
        let bytes = count.saturating_mul(size_of::<T>());
        let before = self.left;
        self.spend(bytes)?;
        let mut vec = Vec::new();
        match vec.try_reserve_exact(count) {
            Ok(()) => Ok(vec),
            Err(_) => Err(self.refused(before, bytes)),
        }
    }

    /// A vector of `count` zeros.
    ///
    /// # Errors
    /// Those of [`Budget::vec`].
    pub(crate) fn zeros<T: Clone + Default>(&mut self, count: usize) -> Result<Vec<T>, Error> {
        let mut vec = self.vec(count)?;
        vec.resize(count, T::default());
        Ok(vec)
    }

    /// Counts memory that is allocated elsewhere.
    ///
    /// # Errors
    /// [`Error::Limits`] where it passes the limit.
    pub(crate) fn spend(&mut self, bytes: usize) -> Result<(), Error> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| self.refused(self.left, bytes))?;
        Ok(())
    }

    /// The error of asking for `bytes` when `left` were left.
    fn refused(&self, left: usize, bytes: usize) -> Error {
        let needed = (self.limit - left).saturating_add(bytes);
        Error::Limits { offset: COUNTS_OFFSET, what: "bytes of memory", needed, limit: self.limit }
    }
}
