//! [`encode`]: packages a field.
//!
//! Rows arrive most important first and are cut into layers. In each layer the static Gaussians
//! part from the dynamic ones, both are sorted along a Morton curve and cut into chunks; the coder
//! `fixed` sorts dynamic ones by cell of the time index first. The same field gives the same bytes
//! on any machine and with any number of threads: chunks are independent, and every decision rests
//! on arithmetic that IEEE 754 defines.

use std::convert::Infallible;
use std::num::NonZero;

use crate::{
    ClipInfo, Coder, Contents, EncodeError, Field, LayerEnd, MAGNITUDE_MAX, PixelFilter, Precision,
    bytes::Writer,
    columns::Columns,
    decode::decode_regions,
    fixed,
    format::{CHUNK_ROWS, LAYERS_MAX, VERSION_MINOR},
    gaussian::{self, ChunkForm, Steps},
    header::PlannedSection,
    order::{Layer, along_curve, split},
    parallel::try_for_each,
    precision::Prepared,
    quant::{f16_finite, f16_positive, f16_value, opacity_code, opacity_value},
    section::{Region, Section, SectionKind},
    time_index::CELLS,
};

/// The content of a package.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Duration, axes, viewpoints.
    pub info: &'a ClipInfo,
    /// The Gaussians, most important first: the first rows make the first layers.
    pub field: &'a Field,
    /// Static background, drawn behind everything else. Must have no temporal columns.
    pub plate: Option<&'a Field>,
}

/// How a package is made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EncodeOptions {
    /// Coding of the Gaussians.
    pub coder: Coder,
    /// Ends of the layers: rising numbers of Gaussians, at most 16. Ends at or above the size of the
    /// field count as one, and the last layer always ends with the field; so the default, no ends,
    /// makes one layer.
    pub layers: Vec<usize>,
    /// Fidelity of the coder `rans`. The coder `fixed` ignores it.
    pub precision: Precision,
    /// Whether a graphics device computed numbers of the field; the package says so.
    pub by_device: bool,
}

/// Packages a field. The same source and options give the same bytes on any machine.
///
/// # Errors
/// - [`EncodeError::Info`] if [`ClipInfo::check`] fails.
/// - [`EncodeError::Field`] if [`Field::check`] fails, a number exceeds 1e9, a Gaussian moves to
///   infinity while alive, or the plate has temporal columns.
/// - [`EncodeError::Empty`] if the field has no Gaussians.
/// - [`EncodeError::Layers`] if the ends are zero, do not rise, or are too many.
/// - [`EncodeError::Precision`] if a number of the precision is invalid, or there are sensitivities of
///   the field or the plate but not one for each Gaussian.
/// - [`EncodeError::TooLarge`] if the package would exceed 4 GiB.
pub fn encode(source: &Source, options: &EncodeOptions) -> Result<Vec<u8>, EncodeError> {
    encode_parallel(source, options, NonZero::<usize>::MIN)
}

/// Encodes as [`encode`] does, on up to `threads` threads. The number of threads does not change
/// the bytes.
///
/// # Errors
/// See [`encode`].
pub fn encode_parallel(
    source: &Source,
    options: &EncodeOptions,
    threads: NonZero<usize>,
) -> Result<Vec<u8>, EncodeError> {
    encode_sections(source, options, &ChunkForms::default(), threads).map(|encoded| encoded.package)
}

/// Choices of the encoder for each chunk of a package: whether neighbours predict, and the steps of the Gaussians. The
/// coder `fixed` makes none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChunkForms {
    /// By section; `None` where neighbours never predict.
    has_neighbors: Vec<Option<bool>>,
    /// By row of the field; none for the coder `fixed`.
    steps: Vec<Steps>,
}

/// A package with the Gaussians that it holds.
#[derive(Clone, Debug)]
pub struct Rounded {
    /// Bytes of the package.
    pub package: Vec<u8>,
    /// The rows and columns of the source, with decoded numbers.
    pub field: Field,
    /// The forms of the chunks.
    pub forms: ChunkForms,
}

/// Encodes as [`encode_parallel`] does, and also returns the Gaussians as the package holds them. Chunks take over
/// `forms`, the forms of a package with as many Gaussians in each chunk. Without `forms`, steps are chosen, and each
/// chunk is coded with and without neighbours, which takes twice as long, and has the smaller form.
///
/// # Errors
/// See [`encode`].
pub fn encode_rounded(
    source: &Source,
    options: &EncodeOptions,
    forms: Option<&ChunkForms>,
    threads: NonZero<usize>,
) -> Result<Rounded, EncodeError> {
    let encoded = encode_sections(source, options, forms.unwrap_or(&ChunkForms::default()), threads)?;
    let Encoded { package, forms, static_rows, dynamic_rows } = encoded;
    let decoded = decode_regions(&package, threads).expect("an encoded package decodes");
    let mut field = source.field.clone();
    field.set_rows(&static_rows, &decoded.static_field);
    field.set_rows(&dynamic_rows, &decoded.dynamic_field);
    field.near = decoded.static_field.near;
    Ok(Rounded { package, field, forms })
}

/// A package with the forms of its chunks and the source rows of its Gaussians, in the order of its sections.
struct Encoded {
    package: Vec<u8>,
    forms: ChunkForms,
    static_rows: Vec<usize>,
    dynamic_rows: Vec<usize>,
}

// Long: the sections of a package, in their order in the file.
fn encode_sections(
    source: &Source,
    options: &EncodeOptions,
    forms: &ChunkForms,
    threads: NonZero<usize>,
) -> Result<Encoded, EncodeError> {
    let Source { info, field, plate } = *source;
    info.check().map_err(|(field, value)| EncodeError::Info { field, value })?;
    check_field("field", field)?;
    plate.map_or(Ok(()), check_plate)?;
    if field.is_empty() {
        return Err(EncodeError::Empty);
    }
    let ends = layer_ends(&options.layers, field.len())?;

    let coder = options.coder;
    let precision = &options.precision;
    let coded_windows;
    let field = match coder {
        Coder::Fixed => {
            coded_windows = with_coded_windows(field);
            &coded_windows
        }
        Coder::Rans => {
            precision.check(field, plate)?;
            field
        }
    };
    let bounds = field.bounds();
    check_bounds(bounds)?;
    let layers = split(field, &ends, bounds, coder);
    let chunks = ChunkEncoder::new(coder, field, || precision.prepare(field, bounds));
    let plate = plate.map(|plate| {
        let chunks = ChunkEncoder::new(coder, plate, || precision.prepare_plate(plate, bounds));
        (chunks, along_curve(plate))
    });
    let mut contents = describe(info, coder, bounds, &chunks, &layers, plate.as_ref());
    contents.filter = field.filter;
    contents.plate_filter = source.plate.map(|plate| plate.filter).unwrap_or_default();
    contents.by_device = options.by_device;
    contents.near = near(field, source.plate);

    let plan: Vec<PlannedSection> = contents.plan().collect();
    let payload = |planned: &PlannedSection, has_neighbors: Option<bool>| {
        let steps =
            Some(&forms.steps[..]).filter(|steps| !steps.is_empty() && planned.region != Region::Plate);
        let form = ChunkForm { has_neighbors, steps };
        let layer = &layers[usize::from(planned.layer)];
        let (chunks, rows) = match planned.region {
            Region::Static => (&chunks, &layer.static_rows),
            Region::Dynamic => (&chunks, &layer.dynamic_rows),
            Region::Plate => plate.as_ref().map(|(chunks, rows)| (chunks, rows)).expect("a plate is planned"),
        };
        match planned.kind {
            SectionKind::TimeIndex => time_index_payload(&layer.cells),
            _ => {
                let start = planned.chunk as usize * CHUNK_ROWS;
                let columns = contents.columns().in_region(planned.region);
                chunks.encode(&rows[start..start + planned.rows], columns, form)
            }
        }
    };
    let mut payloads = vec![Payload::default(); plan.len()];
    let encode = |((i, planned), coded): ((usize, &PlannedSection), &mut Payload)| -> Result<(), Infallible> {
        *coded = payload(planned, forms.has_neighbors.get(i).copied().flatten());
        Ok(())
    };
    let threads = threads.get().min(plan.len());
    try_for_each(plan.iter().enumerate().zip(&mut payloads), vec![encode; threads])
        .unwrap_or_else(|never| match never {});

    let (mut static_rows, mut dynamic_rows) = (Vec::new(), Vec::new());
    for (planned, payload) in plan.iter().zip(&payloads) {
        match planned.region {
            Region::Static => static_rows.extend_from_slice(&payload.rows),
            Region::Dynamic => dynamic_rows.extend_from_slice(&payload.rows),
            Region::Plate => (),
        }
    }
    let forms = ChunkForms {
        has_neighbors: payloads.iter().map(|payload| payload.has_neighbors).collect(),
        steps: steps_of(field, &plan, &payloads),
    };

    let section = |(planned, payload): (&PlannedSection, &Payload)| Section {
        kind: planned.kind,
        critical: true,
        layer: planned.layer,
        region: planned.region,
        chunk: planned.chunk,
        // `Contents::write` computes it from the lengths.
        offset: 0,
        length: payload.bytes.len(),
        raw_length: payload.raw_length,
        crc: crc32fast::hash(&payload.bytes),
    };
    contents.sections = plan.iter().zip(&payloads).map(section).collect();
    let mut package = contents.write()?;
    payloads.iter().for_each(|payload| package.extend_from_slice(&payload.bytes));
    Ok(Encoded { package, forms, static_rows, dynamic_rows })
}

/// Steps of the rows of a field, except its plate; none if no chunk has steps.
fn steps_of(field: &Field, plan: &[PlannedSection], payloads: &[Payload]) -> Vec<Steps> {
    let mut steps = Vec::new();
    for (planned, payload) in plan.iter().zip(payloads) {
        if planned.region != Region::Plate && !payload.steps.is_empty() {
            steps.resize(field.len(), Steps::default());
            payload.rows.iter().zip(&payload.steps).for_each(|(&row, chosen)| steps[row] = *chosen);
        }
    }
    steps
}

/// Encodes chunks of a field.
enum ChunkEncoder<'a> {
    Fixed(&'a Field),
    Rans(Prepared<'a>),
}

impl<'a> ChunkEncoder<'a> {
    fn new(coder: Coder, field: &'a Field, prepare: impl FnOnce() -> Prepared<'a>) -> ChunkEncoder<'a> {
        match coder {
            Coder::Fixed => ChunkEncoder::Fixed(field),
            Coder::Rans => ChunkEncoder::Rans(prepare()),
        }
    }

    fn encode(&self, rows: &[usize], columns: Columns, form: ChunkForm) -> Payload {
        match self {
            ChunkEncoder::Fixed(field) => {
                let chunk = select(field, rows, columns.temporal.is_some());
                let (bytes, raw_length) = fixed::encode(&chunk, columns);
                Payload { bytes, raw_length, rows: rows.to_vec(), ..Payload::default() }
            }
            ChunkEncoder::Rans(prepared) => {
                let chunk = gaussian::encode(prepared, rows, columns, form);
                Payload {
                    raw_length: chunk.payload.len(),
                    bytes: chunk.payload,
                    rows: chunk.rows,
                    steps: chunk.steps,
                    has_neighbors: Some(chunk.has_neighbors),
                }
            }
        }
    }

    /// The columns in which some of `rows` are not zero once coded.
    fn nonzero_columns(&self, rows: &[usize], with_temporal: bool) -> Columns {
        let of_chunk = |rows: &[usize]| match self {
            ChunkEncoder::Fixed(field) => fixed::nonzero_columns(&select(field, rows, with_temporal)),
            ChunkEncoder::Rans(prepared) => Columns::nonzero(prepared.field, rows, with_temporal),
        };
        rows.chunks(CHUNK_ROWS).map(of_chunk).fold(Columns::default(), Columns::union)
    }
}

/// A section as stored.
#[derive(Clone, Debug, Default)]
struct Payload {
    bytes: Vec<u8>,
    /// Length before compression.
    raw_length: usize,
    /// Source rows of the Gaussians, in coded order.
    rows: Vec<usize>,
    /// Steps of the Gaussians of these rows; none for the coder `fixed`.
    steps: Vec<Steps>,
    /// Whether neighbours predict; `None` where they never do.
    has_neighbors: Option<bool>,
}

/// Selects `rows`, without temporal columns unless `with_temporal`.
fn select(field: &Field, rows: &[usize], with_temporal: bool) -> Field {
    let chunk = field.select(rows);
    if with_temporal { chunk } else { Field { temporal: None, ..chunk } }
}

/// Checks [`Field::check`] and that no number exceeds [`MAGNITUDE_MAX`].
fn check_field(part: &'static str, field: &Field) -> Result<(), EncodeError> {
    field.check().map_err(|reason| EncodeError::Field { part, reason })?;
    let temporal = field.temporal.as_ref();
    let columns: [(&str, &[[f32; 3]]); 4] = [
        ("centers", &field.centers),
        ("log_scales", &field.log_scales),
        ("sh", &field.sh),
        ("motion", temporal.map_or(&[], |temporal| &temporal.motion)),
    ];
    let rates = temporal.and_then(|temporal| temporal.rotation_rates.as_deref()).unwrap_or_default();
    let too_large = |x: &f32| x.abs() > MAGNITUDE_MAX;
    let found = columns
        .into_iter()
        .find_map(|(name, column)| column.iter().flatten().find(|x| too_large(x)).map(|x| (name, x)))
        .or_else(|| rates.iter().flatten().find(|x| too_large(x)).map(|x| ("rotation_rates", x)));
    match found {
        None => Ok(()),
        Some((name, x)) => {
            let reason = format!("column {name} holds {x:e}, beyond {MAGNITUDE_MAX:e}");
            Err(EncodeError::Field { part, reason })
        }
    }
}

/// Checks that the box around all positions is finite. A Gaussian can leave it whose window is far
/// from the clip but wide enough to be visible: its trajectory is a cubic of the distance.
fn check_bounds([low, high]: [[f32; 3]; 2]) -> Result<(), EncodeError> {
    if (0..3).all(|axis| (high[axis] - low[axis]).is_finite()) {
        return Ok(());
    }
    let reason = format!("its Gaussians move through a box from {low:?} to {high:?}");
    Err(EncodeError::Field { part: "field", reason })
}

fn check_plate(plate: &Field) -> Result<(), EncodeError> {
    check_field("plate", plate)?;
    match plate.temporal {
        None => Ok(()),
        Some(_) => {
            let reason = "it has temporal columns; a plate is static".into();
            Err(EncodeError::Field { part: "plate", reason })
        }
    }
}

/// The near distance of a package: the field's, or the plate's if the field has none.
fn near(field: &Field, plate: Option<&Field>) -> f32 {
    let plate = plate.map_or(0.0, |plate| plate.near);
    if field.near > 0.0 { field.near } else { plate }
}

/// Ends of the layers of `len` rows: the requested ends below `len`, then `len`.
fn layer_ends(requested: &[usize], len: usize) -> Result<Vec<usize>, EncodeError> {
    let mut ends: Vec<usize> = requested.iter().copied().filter(|&end| end < len).collect();
    ends.push(len);
    if requested.contains(&0) || !requested.is_sorted_by(|a, b| a < b) || ends.len() > LAYERS_MAX {
        return Err(EncodeError::Layers { layers: requested.to_vec() });
    }
    Ok(ends)
}

/// The field with opacities and windows as they will be decoded. They decide which Gaussians are
/// static and the cells of the others.
fn with_coded_windows(field: &Field) -> Field {
    let mut coded = field.clone();
    for opacity in &mut coded.opacities {
        *opacity = opacity_value(opacity_code(*opacity));
    }
    if let Some(temporal) = &mut coded.temporal {
        for tau in &mut temporal.tau {
            *tau = f16_value(f16_finite(*tau));
        }
        for s in &mut temporal.s {
            *s = f16_value(f16_positive(*s));
        }
    }
    coded
}

/// Returns the head of a package, apart from the filters, the near distance and the section table.
fn describe(
    info: &ClipInfo,
    coder: Coder,
    bounds: [[f32; 3]; 2],
    chunks: &ChunkEncoder,
    layers: &[Layer],
    plate: Option<&(ChunkEncoder, Vec<usize>)>,
) -> Contents {
    let columns = layers.iter().fold(Columns::default(), |all, layer| {
        all.union(chunks.nonzero_columns(&layer.static_rows, false))
            .union(chunks.nonzero_columns(&layer.dynamic_rows, true))
    });
    let temporal = columns.temporal.unwrap_or_default();
    let mut end = LayerEnd::default();
    let layer_end = |layer: &Layer| {
        end.static_count += layer.static_rows.len();
        end.dynamic_count += layer.dynamic_rows.len();
        end
    };
    Contents {
        version_minor: VERSION_MINOR,
        info: info.clone(),
        bounds,
        coder,
        sh_degree: columns.sh_degree,
        motion_order: temporal.motion_order,
        rotation_rates: temporal.rotation_rates,
        filter: PixelFilter::default(),
        layers: layers.iter().map(layer_end).collect(),
        plate_len: plate.map_or(0, |(_, rows)| rows.len()),
        plate_filter: PixelFilter::default(),
        by_device: false,
        near: 0.0,
        plate_sh_degree: plate.map_or(0, |(chunks, rows)| chunks.nonzero_columns(rows, false).sh_degree),
        head_bytes: 0,
        head_crc: 0,
        sections: Vec::new(),
    }
}

/// Encodes the number of rows per cell.
fn time_index_payload(cells: &[u32; CELLS]) -> Payload {
    let mut writer = Writer::default();
    for &count in cells {
        writer.leb128(count);
    }
    Payload { raw_length: writer.bytes.len(), bytes: writer.bytes, ..Payload::default() }
}
