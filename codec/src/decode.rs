//! [`decode`]: the bytes of a package to a [`Clip`].
//!
//! Nothing in a package is believed: the head is checked against itself, the length of the file
//! and the caller's limits before anything is allocated, every section against its checksum and
//! its planned length, every decoded number against its range, and the time index against the
//! rows it describes. Columns are allocated once, at their final size, and every chunk writes rows
//! of its own, so that chunks decode on several threads and peak memory is the decoded clip and
//! little more.

use std::num::NonZero;

use crate::{
    Clip, Coder, Error, Field, LayerEnd, Limits, Temporal, TimeIndex,
    bytes::Reader,
    context,
    error::FormatError,
    fixed::{self, Columns, TemporalColumns},
    header::{Contents, Planned, contents},
    limits::Budget,
    parallel::try_for_each,
    rows::Rows,
    section::{Region, Section, SectionKind},
    sh_coefficients,
    time_index::CELLS,
};

/// Decodes a package, or the complete layers of one that was cut short.
///
/// # Errors
/// If the first layer is not complete, or anything in the complete layers is wrong.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Clip, Error> {
    decode_parallel(bytes, limits, NonZero::<usize>::MIN)
}

/// Decodes a package as [`decode`] does, its chunks on up to `threads` threads: as many as there
/// are chunks, the limits have memory for and the system gives. The result is the same for any
/// number. The stacks of the threads do not count toward the limits.
///
/// # Errors
/// Those of [`decode`], and the same ones for any number of threads.
pub fn decode_parallel(bytes: &[u8], limits: &Limits, threads: NonZero<usize>) -> Result<Clip, Error> {
    let contents = contents(bytes, limits)?;
    let complete = complete_layers(&contents, bytes.len())?;
    let layers = &contents.layers[..complete];
    let rows = layers[complete - 1];

    let mut budget = Budget::new(limits);
    let mut region = |region, rows| blank_field(contents.columns(region), rows, &mut budget);
    let mut static_field = region(Region::Static, rows.static_count)?;
    let mut dynamic_field = region(Region::Dynamic, rows.dynamic_count)?;
    let mut plate = region(Region::Plate, contents.plate_len)?;
    let places = match contents.coder {
        Coder::Fixed => Vec::new(),
        Coder::Context => budget.vec(largest_layer(layers))?,
    };

    let sections =
        || contents.planned_sections().take_while(|(planned, _)| usize::from(planned.layer) < complete);
    let chunks = || sections().filter(|(planned, _)| planned.kind == SectionKind::Gaussians);
    let decoders = chunk_decoders(&contents, threads.get().min(chunks().count()), &mut budget)?;
    let decode = |mut decoder: ChunkDecoder| {
        move |(section, columns, rows): (&Section, Columns, Rows)| {
            decoder.decode(section.payload(bytes)?, section, columns, rows)
        }
    };
    let mut rest = [&mut static_field, &mut dynamic_field, &mut plate].map(Rows::of);
    let with_rows = |(planned, section): (Planned, _)| {
        let [static_rows, dynamic_rows, plate] = &mut rest;
        let rest = match planned.region {
            Region::Static => static_rows,
            Region::Dynamic => dynamic_rows,
            Region::Plate => plate,
        };
        (section, contents.columns(planned.region), rest.take(planned.rows))
    };
    try_for_each(chunks().map(with_rows), decoders.into_iter().map(decode).collect())?;

    let time_index = match contents.coder {
        Coder::Fixed => {
            let indices = sections().filter(|(planned, _)| planned.kind == SectionKind::TimeIndex);
            read_time_index(bytes, &dynamic_field, layers, indices)?
        }
        Coder::Context => arrange(&mut dynamic_field, layers, places),
    };
    Ok(Clip {
        bounds: contents.bounds,
        static_field,
        dynamic_field,
        layers: layers.to_vec(),
        layers_announced: contents.layers.len(),
        time_index,
        plate: (contents.plate_len > 0).then_some(plate),
        info: contents.info,
    })
}

/// Number of layers whose sections all end within `available` bytes; at least one.
pub(crate) fn complete_layers(contents: &Contents, available: usize) -> Result<usize, Error> {
    let ends = contents.layer_bytes();
    match ends.partition_point(|&end| end <= available) {
        0 => Err(Error::format(available, FormatError::Cut { needed: ends[0], available })),
        complete => Ok(complete),
    }
}

/// A field with the columns named and `rows` rows of zeros.
pub(crate) fn blank_field(columns: Columns, rows: usize, budget: &mut Budget) -> Result<Field, Error> {
    Ok(Field {
        centers: budget.zeros(rows)?,
        rotations: budget.zeros(rows)?,
        log_scales: budget.zeros(rows)?,
        opacities: budget.zeros(rows)?,
        sh_degree: columns.sh_degree,
        sh: budget.zeros(rows * sh_coefficients(columns.sh_degree))?,
        temporal: match columns.temporal {
            None => None,
            Some(TemporalColumns { motion_order, rotation_rates }) => Some(Temporal {
                tau: budget.zeros(rows)?,
                s: budget.zeros(rows)?,
                motion_order,
                motion: budget.zeros(rows * usize::from(motion_order))?,
                rotation_rates: if rotation_rates { Some(budget.zeros(rows)?) } else { None },
            }),
        },
    })
}

/// The layers, each as where its rows of the dynamic region start and end.
fn dynamic_rows(layers: &[LayerEnd]) -> impl Iterator<Item = std::ops::Range<usize>> {
    let starts = [0].into_iter().chain(layers.iter().map(|end| end.dynamic_count));
    starts.zip(layers).map(|(start, end)| start..end.dynamic_count)
}

/// Most dynamic Gaussians of a layer.
fn largest_layer(layers: &[LayerEnd]) -> usize {
    dynamic_rows(layers).map(|rows| rows.len()).max().unwrap_or(0)
}

/// Checks the stored time index of each layer against the rows.
fn read_time_index<'a>(
    bytes: &[u8],
    dynamic_field: &Field,
    layers: &[LayerEnd],
    mut indices: impl Iterator<Item = (Planned, &'a Section)>,
) -> Result<TimeIndex, Error> {
    let mut time_index = TimeIndex::default();
    for rows in dynamic_rows(layers) {
        // Layers without dynamic Gaussians have no index.
        let index = if rows.is_empty() { None } else { indices.next() };
        let Some((_, section)) = index else {
            time_index.push_layer(&[0; CELLS]);
            continue;
        };
        time_index.push_layer(&read_cells(section.payload(bytes)?, section.offset, rows.len())?);
        if let Some(row) = time_index.first_misplaced(dynamic_field) {
            return Err(Error::format(section.offset, FormatError::TimeIndex { row }));
        }
    }
    Ok(time_index)
}

/// Puts the rows of each layer in the order of the time index. `places` has room for a number for
/// each row of the largest.
fn arrange(dynamic_field: &mut Field, layers: &[LayerEnd], mut places: Vec<u32>) -> TimeIndex {
    let mut time_index = TimeIndex::default();
    for rows in dynamic_rows(layers) {
        time_index.arrange_layer(dynamic_field, rows, &mut places);
    }
    time_index
}

/// Decodes chunks, one at a time.
enum ChunkDecoder {
    /// Decompresses them into one buffer first.
    Fixed {
        zstd: zstd::bulk::Decompressor<'static>,
        raw: Vec<u8>,
    },
    Context,
}

/// At least one decoder, and up to `count` if there is memory for them.
fn chunk_decoders(
    contents: &Contents,
    count: usize,
    budget: &mut Budget,
) -> Result<Vec<ChunkDecoder>, Error> {
    let mut decoders = vec![ChunkDecoder::new(contents, budget)?];
    while decoders.len() < count
        && let Ok(decoder) = ChunkDecoder::new(contents, budget)
    {
        decoders.push(decoder);
    }
    Ok(decoders)
}

impl ChunkDecoder {
    fn new(contents: &Contents, budget: &mut Budget) -> Result<ChunkDecoder, Error> {
        if contents.coder == Coder::Context {
            budget.spend(context::WORK_BYTES)?;
            return Ok(ChunkDecoder::Context);
        }
        let chunks =
            contents.planned_sections().filter(|(planned, _)| planned.kind == SectionKind::Gaussians);
        let largest = chunks.map(|(_, section)| section.raw_length).max().unwrap_or(0);
        let zstd = zstd::bulk::Decompressor::new()
            .map_err(|e| Error::format(0, FormatError::Payload { reason: e.to_string() }))?;
        Ok(ChunkDecoder::Fixed { zstd, raw: budget.vec(largest)? })
    }

    /// Decodes the Gaussians of a chunk into `rows`, which are as many.
    fn decode(
        &mut self,
        payload: &[u8],
        section: &Section,
        columns: Columns,
        rows: Rows,
    ) -> Result<(), Error> {
        let ChunkDecoder::Fixed { zstd, raw } = self else {
            return context::decode(payload, columns, section.offset, rows);
        };
        let damaged = |reason| Error::format(section.offset, FormatError::Payload { reason });
        // The table was checked: this is the length of the rows, and the buffer has it.
        raw.resize(section.raw_length, 0);
        let length = zstd.decompress_to_buffer(payload, &mut raw[..]).map_err(|e| damaged(e.to_string()))?;
        if length != section.raw_length {
            return Err(damaged(format!("expands to {length} bytes instead of {}", section.raw_length)));
        }
        fixed::decode(raw, columns, section.offset, rows)
    }
}

/// Reads the rows per cell of a layer with `rows` Gaussians in its dynamic region.
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
