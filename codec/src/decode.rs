//! [`decode`]: the bytes of a package to a [`Clip`].
//!
//! Nothing in a package is believed: the head is checked against itself, the length of the file
//! and the caller's limits before anything is allocated, every section against its checksum and
//! its planned length, every decoded number against its range, and the time index against the
//! rows it describes. Columns are allocated once, at their final size, and filled from one chunk
//! of work space, so that peak memory is the decoded clip and little more.

use crate::{
    Clip, Coder, Error, Field, LayerEnd, Limits, Temporal, TimeIndex,
    bytes::Reader,
    context,
    error::Fault,
    fixed::{self, Columns, TemporalColumns},
    header::{Contents, LAYERS_MAX, contents},
    limits::Budget,
    section::{Region, Section, SectionKind},
    sh_coefficients,
    time_index::CELLS,
};

/// Decodes a package, or the complete layers of one that was cut short.
///
/// # Errors
/// If the first layer is not complete, or anything in the complete layers is wrong.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Clip, Error> {
    let contents = contents(bytes, limits)?;
    let complete = complete_layers(&contents, bytes.len())?;
    let rows = contents.layers[complete - 1];

    let mut budget = Budget::new(limits);
    let mut decoder = ChunkDecoder::new(&contents, &mut budget)?;
    let mut region = |region, rows| empty_field(contents.columns(region), rows, &mut budget);
    let mut still = region(Region::Still, rows.still)?;
    let mut moving = region(Region::Moving, rows.moving)?;
    let mut plate = region(Region::Plate, contents.plate_len)?;
    let mut index_sections = [None; LAYERS_MAX];
    for (planned, section) in contents.planned_sections() {
        if usize::from(planned.layer) == complete {
            break;
        }
        let payload = section.payload(bytes)?;
        let field = match (planned.kind, planned.region) {
            (SectionKind::TimeIndex, _) => {
                index_sections[usize::from(planned.layer)] = Some((payload, section.offset));
                continue;
            }
            (_, Region::Still) => &mut still,
            (_, Region::Moving) => &mut moving,
            (_, Region::Plate) => &mut plate,
        };
        decoder.decode(payload, section, contents.columns(planned.region), planned.rows, field)?;
    }

    let layers = &contents.layers[..complete];
    let time_index = match contents.coder {
        Coder::Fixed => read_time_index(&moving, layers, &index_sections)?,
        Coder::Context => arrange(&mut moving, layers, &mut budget)?,
    };
    Ok(Clip {
        bounds: contents.bounds,
        still,
        moving,
        layers: layers.to_vec(),
        layers_announced: contents.layers.len(),
        time_index,
        plate: (contents.plate_len > 0).then_some(plate),
        info: contents.info,
    })
}

/// Number of layers whose sections all end within `available` bytes; at least one.
fn complete_layers(contents: &Contents, available: usize) -> Result<usize, Error> {
    let mut complete = contents.layers.len();
    let mut needed = 0;
    for (planned, section) in contents.planned_sections() {
        if section.end() > available {
            complete = complete.min(usize::from(planned.layer));
        }
        if planned.layer == 0 {
            needed = section.end();
        }
    }
    if complete == 0 {
        return Err(Error::format(available, Fault::Cut { needed, available }));
    }
    Ok(complete)
}

/// A field with the columns named and room for `rows` Gaussians.
fn empty_field(columns: Columns, rows: usize, budget: &mut Budget) -> Result<Field, Error> {
    Ok(Field {
        centers: budget.vec(rows)?,
        rotations: budget.vec(rows)?,
        log_scales: budget.vec(rows)?,
        opacities: budget.vec(rows)?,
        sh_degree: columns.sh_degree,
        sh: budget.vec(rows * sh_coefficients(columns.sh_degree))?,
        temporal: match columns.temporal {
            None => None,
            Some(TemporalColumns { motion_order, rotation_rates }) => Some(Temporal {
                tau: budget.vec(rows)?,
                s: budget.vec(rows)?,
                motion_order,
                motion: budget.vec(rows * usize::from(motion_order))?,
                rotation_rates: if rotation_rates { Some(budget.vec(rows)?) } else { None },
            }),
        },
    })
}

/// Checks the stored time index of each layer against the rows.
fn read_time_index(
    moving: &Field,
    layers: &[LayerEnd],
    sections: &[Option<(&[u8], usize)>],
) -> Result<TimeIndex, Error> {
    let mut time_index = TimeIndex::default();
    let mut start = 0;
    for (end, section) in layers.iter().zip(sections) {
        let counts = match section {
            Some((payload, offset)) => read_cells(payload, *offset, end.moving - start)?,
            None => [0; CELLS],
        };
        time_index.push_layer(&counts);
        if let (Some(row), Some((_, offset))) = (time_index.first_misplaced(moving), section) {
            return Err(Error::format(*offset, Fault::TimeIndex { row }));
        }
        start = end.moving;
    }
    Ok(time_index)
}

/// Puts the rows of each layer in the order of the time index.
fn arrange(moving: &mut Field, layers: &[LayerEnd], budget: &mut Budget) -> Result<TimeIndex, Error> {
    let starts = || [0].into_iter().chain(layers.iter().map(|end| end.moving));
    let largest = layers.iter().zip(starts()).map(|(end, start)| end.moving - start).max();
    let mut places = budget.vec(largest.unwrap_or(0))?;
    let mut time_index = TimeIndex::default();
    for (end, start) in layers.iter().zip(starts()) {
        time_index.arrange_layer(moving, start..end.moving, &mut places);
    }
    Ok(time_index)
}

/// Decodes chunks.
enum ChunkDecoder {
    /// Decompresses them into one buffer first.
    Fixed {
        zstd: zstd::bulk::Decompressor<'static>,
        raw: Vec<u8>,
    },
    Context,
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
            .map_err(|e| Error::format(0, Fault::Payload { reason: e.to_string() }))?;
        Ok(ChunkDecoder::Fixed { zstd, raw: budget.vec(largest)? })
    }

    /// Appends the Gaussians of a chunk to `field`.
    fn decode(
        &mut self,
        payload: &[u8],
        section: &Section,
        columns: Columns,
        rows: usize,
        field: &mut Field,
    ) -> Result<(), Error> {
        let ChunkDecoder::Fixed { zstd, raw } = self else {
            return context::decode(payload, columns, rows, section.offset, field);
        };
        let damaged = |reason| Error::format(section.offset, Fault::Payload { reason });
        // The table was checked: this is the length of `rows` Gaussians, and the buffer has it.
        raw.resize(section.raw_length, 0);
        let length = zstd.decompress_to_buffer(payload, &mut raw[..]).map_err(|e| damaged(e.to_string()))?;
        if length != section.raw_length {
            return Err(damaged(format!("expands to {length} bytes instead of {}", section.raw_length)));
        }
        fixed::decode(raw, columns, rows, section.offset, field)
    }
}

/// Reads the rows per cell of a layer with `rows` Gaussians in its moving region.
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
