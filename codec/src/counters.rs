//! [`Work`]: counts what decoding does, in unit tests, so that a test can bound it without a clock.

/// Units of work.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Work {
    /// Bytes that were read or checksummed.
    Bytes,
    /// Visits to entries of the tables of sections and segments, to the sections that the counts require, and
    /// to the segments that hold an instant.
    Sections,
    /// Symbols of the coder `rans`.
    Symbols,
    /// Visits to Gaussians, and to runs of cells.
    Rows,
}

impl Work {
    /// Counts `units` on this thread. Does nothing outside unit tests.
    #[cfg(not(test))]
    #[inline(always)]
    pub(crate) fn count(self, _: usize) {}

    /// Counts `units` on this thread.
    #[cfg(test)]
    pub(crate) fn count(self, units: usize) {
        COUNTS.with(|counts| {
            let mut sums = counts.get();
            sums[self as usize] += units;
            counts.set(sums);
        });
    }
}

#[cfg(test)]
thread_local! {
    /// Work of this thread, by [`Work`].
    static COUNTS: std::cell::Cell<[usize; 4]> = const { std::cell::Cell::new([0; 4]) };
}

#[cfg(test)]
#[cfg(feature = "encode")]
mod tests;
