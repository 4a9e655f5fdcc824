//! [`Take::segment_contents`], [`Take::decode_segment`] and [`Take::decode_segment_layers`]: read the head of one segment
//! of a take, and decode it.
//!
//! A segment is a clip package. Its head is compared with the table of the take, and its Gaussians are decoded
//! into the columns of the take, so that all segments have the same ones. The checksum at the end of the head is
//! compared before anything is read: where other bytes stand in place of a segment, the error says so, and does not
//! depend on those bytes.

use std::num::NonZero;

use crate::{
    Clip, Contents, Error, FormatError, Layers, Limits, PixelFilter, Take,
    decode::{decode_contents, decode_further},
    format::LAYERS_OFFSET,
    header::contents_of,
    limits::Budget,
    preamble::Head,
    take::table::prefixes,
};

impl Take {
    /// Decodes segment `index` from the bytes of its package, or its complete layers from a prefix, on up to
    /// `threads`
    /// threads.
    ///
    /// The clip has the SH degrees, motion order, rotation rates and near distance of the take; columns that the
    /// segment lacks are zero. `limits` bound the table of the take and this segment together. A player that holds several segments
    /// must add up their sizes itself.
    ///
    /// # Errors
    /// As [`decode`](crate::decode()), where [`FormatError::Truncated`] counts bytes of the segment; also
    /// [`FormatError::Segment`] if the package contradicts the table, and
    /// [`FormatError::Take`] if it is a take. Offsets count from the start of the take.
    ///
    /// # Panics
    /// If there is no such segment.
    pub fn decode_segment(
        &self,
        index: usize,
        bytes: &[u8],
        limits: &Limits,
        threads: NonZero<usize>,
    ) -> Result<Clip, Error> {
        self.based(index, || {
            let mut budget = Budget::new(limits);
            let contents = self.contents_at_zero(index, bytes, limits, &mut budget)?;
            let contents = Contents { near: self.near, ..contents };
            decode_contents(bytes, contents, self.columns(), &mut budget, threads)
        })
    }

    /// Decodes the complete layers of segment `index` from layer `first` on, counted from 0, without earlier layers, as
    /// [`Contents::decode_layers`] does: for a clip that [`Take::decode_segment`] decoded up to there.
    ///
    /// # Errors
    /// As [`Take::decode_segment`], for the sections of these layers; [`FormatError::Truncated`] if `bytes` ends before
    /// layer `first` does.
    ///
    /// # Panics
    /// If there is no such segment, or `first` is 0 or not a layer of the segment.
    pub fn decode_segment_layers(
        &self,
        index: usize,
        bytes: &[u8],
        first: usize,
        limits: &Limits,
        threads: NonZero<usize>,
    ) -> Result<Layers, Error> {
        self.based(index, || {
            let mut budget = Budget::new(limits);
            let contents = self.contents_at_zero(index, bytes, limits, &mut budget)?;
            let contents = Contents { near: self.near, ..contents };
            decode_further(bytes, &contents, self.columns(), first, &mut budget, threads)
        })
    }

    /// Reads the head of segment `index` from the bytes of its package, or from a prefix that has its first layer,
    /// without decoding any Gaussian, and compares it with the table.
    ///
    /// # Errors
    /// As [`Take::decode_segment`].
    ///
    /// # Panics
    /// If there is no such segment.
    pub fn segment_contents(&self, index: usize, bytes: &[u8], limits: &Limits) -> Result<Contents, Error> {
        self.based(index, || self.contents_at_zero(index, bytes, limits, &mut Budget::new(limits)))
    }

    /// Reads segment `index`: errors of `read` have offsets in its package, those that are returned in the take.
    fn based<T>(&self, index: usize, read: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
        let base = usize::try_from(self.segments[index].offset).unwrap_or(usize::MAX);
        read().map_err(|error| error.rebased(base))
    }

    /// Reads the head of a segment; errors have offsets in its package.
    fn contents_at_zero(
        &self,
        index: usize,
        bytes: &[u8],
        limits: &Limits,
        budget: &mut Budget,
    ) -> Result<Contents, Error> {
        budget.spend(self.table_bytes)?;
        let (needed, available) =
            (self.segments[index].layers.first().map_or(0, |layer| layer.bytes), bytes.len());
        if available < needed {
            return Err(Error::format(available, FormatError::Truncated { needed, available }));
        }
        self.check_announced(index, bytes)?;
        let head = Head::checked(bytes)?;
        if head.is_take() {
            return Err(Error::format(LAYERS_OFFSET, FormatError::Take));
        }
        let contents = contents_of(&head, bytes.len(), limits, budget)?;
        self.check_segment(index, &contents)?;
        Ok(contents)
    }

    /// Checks that `bytes` end their head with the checksum that the table announces for segment `index`.
    fn check_announced(&self, index: usize, bytes: &[u8]) -> Result<(), Error> {
        let announced = self.segments[index].head_crc;
        let (at, found) = match Head::stored_crc(bytes) {
            Some((_, crc)) if crc == announced => return Ok(()),
            Some((at, crc)) => (at, format!("one with CRC-32 {crc:08x}")),
            None if bytes.iter().all(|byte| *byte == 0) => (0, "only zeros".into()),
            None => (0, "other bytes".into()),
        };
        let expected = format!("a head with CRC-32 {announced:08x}");
        Err(Error::format(at, FormatError::Segment { segment: index, expected, found }))
    }

    /// Checks the head of a segment against the head and the table of the take.
    fn check_segment(&self, index: usize, contents: &Contents) -> Result<(), Error> {
        let error = |at, expected: String, found: String| {
            Err(Error::format(at, FormatError::Segment { segment: index, expected, found }))
        };
        if contents.coder != self.coder {
            let [expected, found] =
                [self.coder, contents.coder].map(|coder| format!("coder {}", coder.name()));
            return error(60, expected, found);
        }
        let columns = contents.columns();
        if columns.union(self.columns()) != self.columns() {
            return error(61, format!("at most {:?}", self.columns()), format!("{columns:?}"));
        }
        if contents.filter != self.filter
            || contents.plate_len > 0 && contents.plate_filter != self.plate_filter
        {
            let filters = |a: PixelFilter, b: PixelFilter| format!("filters {}, {}", a.name(), b.name());
            let expected = filters(self.filter, self.plate_filter);
            return error(63, expected, filters(contents.filter, contents.plate_filter));
        }
        if contents.plate_len > self.plate_len {
            let [expected, found] =
                [self.plate_len, contents.plate_len].map(|len| format!("a plate of {len} Gaussians"));
            return error(68, format!("at most {expected}"), found);
        }
        let found = prefixes(contents);
        if found != self.segments[index].layers {
            return error(76, format!("{:?}", self.segments[index].layers), format!("{found:?}"));
        }
        Ok(())
    }
}
