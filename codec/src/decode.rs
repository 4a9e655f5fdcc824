//! [`decode`] and [`Contents::decode_layers`]: decode the bytes of a package to a [`Clip`], and further layers of it
//! alone.
//!
//! No number in a package is trusted. The head is checked against itself, the length of the file
//! and the caller's limits before anything is allocated; every section against its checksum and
//! planned length; every decoded number against its range; the time index against its rows.
//! Columns are allocated once, at their final size, and every chunk writes its own rows. So chunks
//! decode on several threads, and peak memory is little more than the decoded clip.

use std::num::NonZero;
use std::ops::Range;

use crate::{
    Clip, Coder, Error, Field, LayerEnd, Layers, Limits, TimeIndex,
    bytes::Reader,
    columns::{Columns, PackageColumns},
    error::FormatError,
    fixed, gaussian,
    header::{Contents, PlannedSection, check_count, check_end, contents_within},
    limits::Budget,
    parallel::try_for_each,
    rows::Rows,
    section::{Region, Section, SectionKind},
    time_index::{CELLS, SORTING_NUMBERS},
};

/// Decodes a package, or the complete layers of a prefix of a package.
///
/// # Errors
/// - [`Error::Format`] if the head or anything in the complete layers is damaged or inconsistent;
///   with [`FormatError::Truncated`] if `bytes` ends before the first layer does.
/// - [`Error::Version`] if the major version is not [`VERSION_MAJOR`](crate::VERSION_MAJOR).
/// - [`Error::Limits`] if decoding needs more than `limits`.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Clip, Error> {
    decode_parallel(bytes, limits, NonZero::<usize>::MIN)
}

/// Decodes as [`decode`] does, on up to `threads` threads.
///
/// A chunk of 4096 Gaussians is the unit of work. Fewer threads run if there are fewer chunks, if
/// `limits` have no memory for more work space, or if the system cannot start more. The number of
/// threads changes neither the clip nor the error. Thread stacks do not count toward `limits`.
///
/// # Errors
/// See [`decode`].
pub fn decode_parallel(bytes: &[u8], limits: &Limits, threads: NonZero<usize>) -> Result<Clip, Error> {
    let mut budget = Budget::new(limits);
    let contents = contents_within(bytes, limits, &mut budget)?;
    let columns = contents.columns();
    decode_contents(bytes, contents, columns, &mut budget, threads)
}

impl Contents {
    /// Decodes the complete layers of `bytes` from layer `first` on, counted from 0, without earlier layers, on up to
    /// `threads` threads. [`Clip::append`] adds them to a clip that was decoded up to there; the clip then equals the
    /// clip that [`decode`] makes of `bytes`.
    ///
    /// `bytes` are the package of this head, or a prefix of it. `limits` bound the whole clip: the layers before count,
    /// and so does the section table.
    ///
    /// # Errors
    /// As [`decode`], for the sections of these layers; [`FormatError::Truncated`] if `bytes` ends before layer `first`
    /// does.
    ///
    /// # Panics
    /// If `first` is 0 or not a layer of the package.
    pub fn decode_layers(
        &self,
        bytes: &[u8],
        first: usize,
        limits: &Limits,
        threads: NonZero<usize>,
    ) -> Result<Layers, Error> {
        let mut budget = Budget::new(limits);
        budget.spend(size_of_val(&self.sections[..]))?;
        check_count(self, limits)?;
        check_end(self, bytes.len())?;
        decode_further(bytes, self, self.columns(), first, &mut budget, threads)
    }
}

/// Decodes the complete layers of `bytes`, whose head is `contents`, to a clip that has `columns`: the columns of
/// the package, or more, which are zero.
///
/// # Errors
/// See [`decode`].
pub(crate) fn decode_contents(
    bytes: &[u8],
    contents: Contents,
    columns: PackageColumns,
    budget: &mut Budget,
    threads: NonZero<usize>,
) -> Result<Clip, Error> {
    let complete = complete_layers(&contents, 0, bytes.len())?;
    let (layers, plate) = decode_chunks(bytes, &contents, columns, 0..complete, budget, threads)?;
    let Layers { before: _, static_field, dynamic_field, ends, time_index } = layers;
    Ok(Clip {
        bounds: contents.bounds,
        static_field,
        dynamic_field,
        layers: ends,
        layers_announced: contents.layers,
        time_index,
        plate: (contents.plate_len > 0).then_some(plate),
        info: contents.info,
    })
}

/// Decodes the complete layers of `bytes` from layer `first` on, as [`decode_contents`] does from layer 0 on.
///
/// # Errors
/// See [`Contents::decode_layers`].
///
/// # Panics
/// See [`Contents::decode_layers`].
pub(crate) fn decode_further(
    bytes: &[u8],
    contents: &Contents,
    columns: PackageColumns,
    first: usize,
    budget: &mut Budget,
    threads: NonZero<usize>,
) -> Result<Layers, Error> {
    assert!((1..contents.layers.len()).contains(&first), "layer {first} of {}", contents.layers.len());
    let complete = complete_layers(contents, first, bytes.len())?;
    // The rows that the caller has already.
    let before = LayerEnd::before(&contents.layers, first);
    for (region, rows) in [
        (Region::Static, before.static_count),
        (Region::Dynamic, before.dynamic_count),
        (Region::Plate, contents.plate_len),
    ] {
        budget.spend(columns.in_region(region).row_bytes().saturating_mul(rows))?;
    }
    decode_chunks(bytes, contents, columns, first..complete, budget, threads).map(|(layers, _)| layers)
}

/// Decodes complete layers. Layer 0 has the plate, which is returned, too.
///
/// # Errors
/// See [`decode`].
fn decode_chunks(
    bytes: &[u8],
    contents: &Contents,
    columns: PackageColumns,
    layers: Range<usize>,
    budget: &mut Budget,
    threads: NonZero<usize>,
) -> Result<(Layers, Field), Error> {
    let before = LayerEnd::before(&contents.layers, layers.start);
    let ends = &contents.layers[layers.clone()];
    let scratch = match contents.coder {
        Coder::Fixed => Vec::new(),
        Coder::Rans => budget
            .vec(SORTING_NUMBERS * dynamic_rows(before, ends).map(|rows| rows.len()).max().unwrap_or(0))?,
    };
    let Regions { static_field, mut dynamic_field, plate } =
        Regions::decode(bytes, contents, columns, layers.clone(), budget, threads)?;
    let time_index = match contents.coder {
        Coder::Fixed => {
            let indices =
                sections(contents, layers).filter(|(planned, _)| planned.kind == SectionKind::TimeIndex);
            read_time_index(bytes, &dynamic_field, before, ends, indices)?
        }
        Coder::Rans => sort_by_cell(&mut dynamic_field, before, ends, scratch),
    };
    Ok((Layers { before, static_field, dynamic_field, ends: ends.to_vec(), time_index }, plate))
}

/// The Gaussians of some layers, in the order of their sections.
pub(crate) struct Regions {
    pub(crate) static_field: Field,
    pub(crate) dynamic_field: Field,
    plate: Field,
}

/// Decodes a complete package to its Gaussians in the order of their sections.
///
/// # Errors
/// See [`decode`].
#[cfg(feature = "encode")]
pub(crate) fn decode_regions(package: &[u8], threads: NonZero<usize>) -> Result<Regions, Error> {
    let limits = Limits { max_gaussians: usize::MAX, max_bytes: usize::MAX };
    let mut budget = Budget::new(&limits);
    let contents = contents_within(package, &limits, &mut budget)?;
    let layers = 0..contents.layers.len();
    Regions::decode(package, &contents, contents.columns(), layers, &mut budget, threads)
}

impl Regions {
    /// Decodes complete layers, at least one. The plate is empty without layer 0.
    fn decode(
        bytes: &[u8],
        contents: &Contents,
        columns: PackageColumns,
        layers: Range<usize>,
        budget: &mut Budget,
        threads: NonZero<usize>,
    ) -> Result<Regions, Error> {
        let (before, end) =
            (LayerEnd::before(&contents.layers, layers.start), contents.layers[layers.end - 1]);
        let mut region = |region, rows| columns.in_region(region).zeros(rows, budget);
        let mut static_field = region(Region::Static, end.static_count - before.static_count)?;
        let mut dynamic_field = region(Region::Dynamic, end.dynamic_count - before.dynamic_count)?;
        let mut plate = region(Region::Plate, if layers.start == 0 { contents.plate_len } else { 0 })?;
        (static_field.filter, dynamic_field.filter) = (contents.filter, contents.filter);
        plate.filter = contents.plate_filter;
        for field in [&mut static_field, &mut dynamic_field, &mut plate] {
            field.near = contents.near;
        }

        let chunks = || {
            sections(contents, layers.clone()).filter(|(planned, _)| planned.kind == SectionKind::Gaussians)
        };
        let decoders = chunk_decoders(contents, threads.get().min(chunks().count()), budget)?;
        let decode = |mut decoder: ChunkDecoder| {
            move |(section, columns, rows): (&Section, Columns, Rows)| {
                decoder.decode(section.payload(bytes)?, section, columns, rows)
            }
        };
        let mut rest = [&mut static_field, &mut dynamic_field, &mut plate].map(Rows::all);
        let with_rows = |(planned, section): (PlannedSection, _)| {
            let [static_rows, dynamic_rows, plate] = &mut rest;
            let rest = match planned.region {
                Region::Static => static_rows,
                Region::Dynamic => dynamic_rows,
                Region::Plate => plate,
            };
            (section, contents.columns().in_region(planned.region), rest.split_off(planned.rows))
        };
        try_for_each(chunks().map(with_rows), decoders.into_iter().map(decode).collect())?;
        Ok(Regions { static_field, dynamic_field, plate })
    }
}

/// The required sections of some layers.
fn sections(contents: &Contents, layers: Range<usize>) -> impl Iterator<Item = (PlannedSection, &Section)> {
    let layer = |planned: &PlannedSection| usize::from(planned.layer);
    let first = contents.planned_sections().skip_while(move |(planned, _)| layer(planned) < layers.start);
    first.take_while(move |(planned, _)| layer(planned) < layers.end)
}

/// Number of layers that lie completely in the first `available` bytes; more than `first`.
///
/// # Errors
/// [`FormatError::Truncated`] if layer `first`, counted from 0, does not.
pub(crate) fn complete_layers(contents: &Contents, first: usize, available: usize) -> Result<usize, Error> {
    let ends = contents.layer_bytes();
    let complete = ends.partition_point(|&end| end <= available);
    if complete > first {
        return Ok(complete);
    }
    Err(Error::format(available, FormatError::Truncated { needed: ends[first], available }))
}

/// The rows in the dynamic region of each of the layers that end at `ends`, counted from the first of them, before which
/// there are `before`.
fn dynamic_rows(before: LayerEnd, ends: &[LayerEnd]) -> impl Iterator<Item = Range<usize>> {
    let count = move |end: &LayerEnd| end.dynamic_count - before.dynamic_count;
    let starts = [0].into_iter().chain(ends.iter().map(count));
    starts.zip(ends).map(move |(start, end)| start..count(end))
}

/// Reads the stored time index of each layer and checks it against the rows.
fn read_time_index<'a>(
    bytes: &[u8],
    dynamic_field: &Field,
    before: LayerEnd,
    ends: &[LayerEnd],
    mut indices: impl Iterator<Item = (PlannedSection, &'a Section)>,
) -> Result<TimeIndex, Error> {
    let mut time_index = TimeIndex::default();
    for rows in dynamic_rows(before, ends) {
        // Layers without dynamic Gaussians have no index.
        let index = if rows.is_empty() { None } else { indices.next() };
        let Some((_, section)) = index else {
            time_index.push_layer(&[0; CELLS]);
            continue;
        };
        time_index.push_layer(&read_cells(section.payload(bytes)?, section.offset, rows.len())?);
        if let Some(row) = time_index.first_misplaced(dynamic_field) {
            let row = before.dynamic_count + row;
            return Err(Error::format(section.offset, FormatError::TimeIndex { row }));
        }
    }
    Ok(time_index)
}

/// Sorts the rows of each layer by cell and indexes them. `scratch` has a capacity of
/// [`SORTING_NUMBERS`] for each row of the largest layer.
fn sort_by_cell(
    dynamic_field: &mut Field,
    before: LayerEnd,
    ends: &[LayerEnd],
    mut scratch: Vec<u32>,
) -> TimeIndex {
    let mut time_index = TimeIndex::default();
    for rows in dynamic_rows(before, ends) {
        time_index.sort_layer(dynamic_field, rows, &mut scratch);
    }
    time_index
}

/// Decodes chunks, one at a time.
enum ChunkDecoder {
    /// Decompresses into a buffer first.
    Fixed {
        zstd: zstd::bulk::Decompressor<'static>,
        raw: Vec<u8>,
    },
    Rans,
}

/// Creates one decoder, and up to `count` if `budget` suffices.
fn chunk_decoders(
    contents: &Contents,
    count: usize,
    budget: &mut Budget,
) -> Result<Vec<ChunkDecoder>, Error> {
    let chunks = contents.planned_sections().filter(|(planned, _)| planned.kind == SectionKind::Gaussians);
    let largest = chunks.map(|(_, section)| section.raw_length).max().unwrap_or(0);
    let mut decoders = vec![ChunkDecoder::new(contents, largest, budget)?];
    while decoders.len() < count
        && let Ok(decoder) = ChunkDecoder::new(contents, largest, budget)
    {
        decoders.push(decoder);
    }
    Ok(decoders)
}

impl ChunkDecoder {
    /// Creates a decoder of chunks of up to `largest` bytes before compression.
    fn new(contents: &Contents, largest: usize, budget: &mut Budget) -> Result<ChunkDecoder, Error> {
        match contents.coder {
            Coder::Fixed => {
                let zstd = zstd::bulk::Decompressor::new()
                    .map_err(|e| Error::format(0, FormatError::Payload { reason: e.to_string() }))?;
                Ok(ChunkDecoder::Fixed { zstd, raw: budget.vec(largest)? })
            }
            Coder::Rans => {
                budget.spend(gaussian::WORK_BYTES)?;
                Ok(ChunkDecoder::Rans)
            }
        }
    }

    /// Decodes a chunk into `rows`, as many as it holds.
    fn decode(
        &mut self,
        payload: &[u8],
        section: &Section,
        columns: Columns,
        rows: Rows,
    ) -> Result<(), Error> {
        let (zstd, raw) = match self {
            ChunkDecoder::Fixed { zstd, raw } => (zstd, raw),
            ChunkDecoder::Rans => return gaussian::decode(payload, columns, section.offset, rows),
        };
        let damaged = |reason| Error::format(section.offset, FormatError::Payload { reason });
        // The section table is checked: the length fits the rows, and the buffer has the capacity.
        raw.resize(section.raw_length, 0);
        let length = zstd.decompress_to_buffer(payload, &mut raw[..]).map_err(|e| damaged(e.to_string()))?;
        if length != section.raw_length {
            return Err(damaged(format!("expands to {length} bytes instead of {}", section.raw_length)));
        }
        fixed::decode(raw, columns, section.offset, rows)
    }
}

/// Reads the number of rows per cell of a layer with `rows` dynamic Gaussians.
fn read_cells(payload: &[u8], offset: usize, rows: usize) -> Result<[u32; CELLS], Error> {
    let mut reader = Reader::new(payload, offset, "time index");
    let mut counts = [0; CELLS];
    let mut sum = 0;
    for count in &mut counts {
        let at = reader.at();
        *count = reader.leb128()?;
        sum += *count as usize;
        if sum > rows {
            return Err(Error::value(at, "time index: more rows in its cells than in the layer", sum));
        }
    }
    if sum < rows {
        return Err(Error::value(reader.at(), "time index: fewer rows in its cells than in the layer", sum));
    }
    reader.finish()?;
    Ok(counts)
}
