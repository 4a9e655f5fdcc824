//! [`encode`]: a field to the bytes of a package.
//!
//! Rows arrive most important first and are cut into layers; in a layer, motionless Gaussians
//! that are always on part from the others, and each group is put along a Morton curve and cut
//! into chunks; the coder `fixed` stores dynamic ones by cell of the time index first. The same
//! field gives the same bytes on any machine and any number of threads: chunks are independent, and
//! every decision rests on arithmetic that IEEE 754 defines.

use std::convert::Infallible;
use std::num::NonZero;

use crate::{
    ClipInfo, Coder, Contents, EncodeError, Field, LayerEnd, Precision,
    bytes::Writer,
    context::{self, Prepared},
    fixed::{self, Columns, TemporalColumns},
    header::{CHUNK_ROWS, LAYERS_MAX, Planned, VERSION_MINOR},
    parallel::try_for_each,
    quant::{f16_finite, f16_positive, f16_value, opacity_code, opacity_value},
    section::{Region, Section, SectionKind},
    time_index::{CELLS, cell_of},
};

/// Largest magnitude of a number in a field. Decoded numbers and their cubic sums stay finite.
const MAGNITUDE_MAX: f32 = 1e9;

/// Opacity that a Gaussian drawn as constant may be off by: half a step of an 8-bit pixel.
const STATIC_OPACITY: f64 = 0.5 / 255.0;

/// What a package is made of.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Duration, axes, viewpoints.
    pub info: &'a ClipInfo,
    /// The Gaussians, most important first.
    pub field: &'a Field,
    /// Static background, without temporal columns.
    pub plate: Option<&'a Field>,
}

/// How a package is made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EncodeOptions {
    /// How the Gaussians are coded.
    pub coder: Coder,
    /// Ends of the layers as rising numbers of Gaussians, at most 16. Those at or above the size
    /// of the field collapse into one, and the last layer always reaches to the end of the field;
    /// so the default, none, is one layer.
    pub layers: Vec<usize>,
    /// How exactly the coder `context` keeps the field.
    pub precision: Precision,
}

/// Packages a field. The same source gives the same bytes on any machine.
///
/// # Errors
/// If the source breaks its own invariants, holds no Gaussians or numbers beyond 1e9, the layers
/// do not rise, or there are sensitivities but not one positive number for each Gaussian.
pub fn encode(source: &Source, options: &EncodeOptions) -> Result<Vec<u8>, EncodeError> {
    encode_parallel(source, options, NonZero::<usize>::MIN)
}

/// Packages a field as [`encode`] does, its chunks on up to `threads` threads. The bytes are the
/// same for any number.
///
/// # Errors
/// Those of [`encode`].
pub fn encode_parallel(
    source: &Source,
    options: &EncodeOptions,
    threads: NonZero<usize>,
) -> Result<Vec<u8>, EncodeError> {
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
        Coder::Context => {
            precision.check(field)?;
            field
        }
    };
    let bounds = field.bounds();
    check_bounds(bounds)?;
    let layers = split(field, &ends, bounds, coder);
    let subject = Part::new(coder, field, || precision.prepare(field, bounds));
    let plate = plate.map(|plate| Part::new(coder, plate, || precision.prepare_plate(plate, bounds)));
    let plate_rows = plate.as_ref().map_or(Vec::new(), Part::rows_by_place);
    let mut contents = describe(info, coder, bounds, &subject, &layers, plate.as_ref(), &plate_rows);

    let plan: Vec<Planned> = contents.plan().collect();
    let payload = |planned: &Planned| {
        let layer = &layers[usize::from(planned.layer)];
        let (part, rows) = match planned.region {
            Region::Static => (&subject, &layer.static_rows),
            Region::Dynamic => (&subject, &layer.dynamic_rows),
            Region::Plate => (plate.as_ref().expect("a planned plate is there"), &plate_rows),
        };
        match planned.kind {
            SectionKind::TimeIndex => time_index_payload(&layer.cells),
            _ => {
                let start = planned.chunk as usize * CHUNK_ROWS;
                part.encode(&rows[start..start + planned.rows], contents.columns(planned.region))
            }
        }
    };
    let mut payloads = vec![(Vec::new(), 0); plan.len()];
    let encode = |(planned, coded): (&Planned, &mut (Vec<u8>, usize))| -> Result<(), Infallible> {
        *coded = payload(planned);
        Ok(())
    };
    let threads = threads.get().min(plan.len());
    try_for_each(plan.iter().zip(&mut payloads), vec![encode; threads])
        .unwrap_or_else(|never| match never {});

    let section = |(planned, (payload, raw_length)): (&Planned, &(Vec<u8>, usize))| Section {
        kind: planned.kind,
        critical: true,
        layer: planned.layer,
        region: planned.region,
        chunk: planned.chunk,
        // Known once the length of the table is.
        offset: 0,
        length: payload.len(),
        raw_length: *raw_length,
        crc: crc32fast::hash(payload),
    };
    contents.sections = plan.iter().zip(&payloads).map(section).collect();
    let mut package = contents.write()?;
    payloads.iter().for_each(|(payload, _)| package.extend_from_slice(payload));
    Ok(package)
}

/// The rows of a layer in the order in which they are cut into chunks.
struct Layer {
    /// The always-on, motionless Gaussians.
    static_rows: Vec<usize>,
    /// The others.
    dynamic_rows: Vec<usize>,
    /// Number of dynamic rows per cell of the time index, where that is stored.
    cells: [u32; CELLS],
}

/// A field and what its coder must know of it.
enum Part<'a> {
    Fixed(&'a Field),
    Context(Prepared<'a>),
}

impl<'a> Part<'a> {
    fn new(coder: Coder, field: &'a Field, prepare: impl FnOnce() -> Prepared<'a>) -> Part<'a> {
        match coder {
            Coder::Fixed => Part::Fixed(field),
            Coder::Context => Part::Context(prepare()),
        }
    }

    fn field(&self) -> &'a Field {
        match self {
            Part::Fixed(field) => field,
            Part::Context(prepared) => prepared.field,
        }
    }

    /// All rows, along a Morton curve.
    fn rows_by_place(&self) -> Vec<usize> {
        let mut rows: Vec<usize> = (0..self.field().len()).collect();
        let field = self.field();
        sort_by_place(&mut rows, field.bounds(), |i| (0, field.centers[i]));
        rows
    }

    /// The payload of a chunk, and its length before compression.
    fn encode(&self, rows: &[usize], columns: Columns) -> (Vec<u8>, usize) {
        match self {
            Part::Fixed(field) => fixed::encode(&chunk(field, rows, columns.temporal.is_some()), columns),
            Part::Context(prepared) => {
                let payload = context::encode(prepared, rows, columns);
                let length = payload.len();
                (payload, length)
            }
        }
    }

    /// The columns that are not zero throughout once coded.
    fn columns_needed(&self, rows: &[usize], with_temporal: bool) -> Columns {
        let of_chunk = |rows: &[usize]| match self {
            Part::Fixed(field) => fixed::columns_needed(&chunk(field, rows, with_temporal)),
            Part::Context(prepared) => context::columns_needed(prepared.field, rows, with_temporal),
        };
        rows.chunks(CHUNK_ROWS).map(of_chunk).fold(Columns::default(), union)
    }
}

/// The named rows, without temporal columns unless `with_temporal`.
fn chunk(field: &Field, rows: &[usize], with_temporal: bool) -> Field {
    let chunk = field.select(rows);
    if with_temporal { chunk } else { Field { temporal: None, ..chunk } }
}

/// The columns of either.
fn union(a: Columns, b: Columns) -> Columns {
    Columns {
        sh_degree: a.sh_degree.max(b.sh_degree),
        temporal: a.temporal.into_iter().chain(b.temporal).reduce(|a, b| TemporalColumns {
            motion_order: a.motion_order.max(b.motion_order),
            rotation_rates: a.rotation_rates || b.rotation_rates,
        }),
    }
}

/// Checks what [`Field::check`] checks, and that no number is too large.
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

/// Checks that all Gaussians stay where numbers are finite. One whose window is far from the clip
/// but wide enough to be seen may not: its trajectory is a polynomial of the distance.
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

/// Ends of the layers of `len` rows: those asked for below `len`, then `len`.
fn layer_ends(asked: &[usize], len: usize) -> Result<Vec<usize>, EncodeError> {
    let mut ends: Vec<usize> = asked.iter().copied().filter(|&end| end < len).collect();
    ends.push(len);
    if asked.contains(&0) || !asked.is_sorted_by(|a, b| a < b) || ends.len() > LAYERS_MAX {
        return Err(EncodeError::Layers { layers: asked.to_vec() });
    }
    Ok(ends)
}

/// The field with opacities and windows as they will be decoded: which Gaussians are static and
/// where the others lie in the time index is decided on these.
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

/// Cuts a field into layers and puts each in order.
fn split(field: &Field, ends: &[usize], bounds: [[f32; 3]; 2], coder: Coder) -> Vec<Layer> {
    let mut start = 0;
    let layer = |&end: &usize| {
        let (mut static_rows, mut dynamic_rows): (Vec<_>, Vec<_>) =
            (start..end).partition(|&i| is_static(field, i));
        start = end;
        sort_by_place(&mut static_rows, bounds, |i| (0, field.centers[i]));
        let mut cells = [0; CELLS];
        match coder {
            Coder::Fixed => {
                sort_by_place(&mut dynamic_rows, bounds, |i| (cell_of(field, i), field.centers[i]));
                dynamic_rows.iter().for_each(|&i| cells[cell_of(field, i)] += 1);
            }
            // The decoder sorts by cell.
            Coder::Context => sort_by_place(&mut dynamic_rows, bounds, |i| (0, middle_of_life(field, i))),
        }
        Layer { static_rows, dynamic_rows, cells }
    };
    ends.iter().map(layer).collect()
}

/// What the head says of a split field, apart from the section table.
fn describe(
    info: &ClipInfo,
    coder: Coder,
    bounds: [[f32; 3]; 2],
    subject: &Part,
    layers: &[Layer],
    plate: Option<&Part>,
    plate_rows: &[usize],
) -> Contents {
    let columns = layers.iter().fold(Columns::default(), |all, layer| {
        let columns = subject.columns_needed(&layer.static_rows, false);
        union(all, union(columns, subject.columns_needed(&layer.dynamic_rows, true)))
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
        layers: layers.iter().map(layer_end).collect(),
        plate_len: plate_rows.len(),
        plate_sh_degree: plate.map_or(0, |plate| plate.columns_needed(plate_rows, false).sh_degree),
        head_bytes: 0,
        sections: Vec::new(),
    }
}

/// Whether Gaussian `i` looks the same all through the clip: it neither moves nor turns, and its
/// opacity falls by no more than [`STATIC_OPACITY`].
pub(crate) fn is_static(field: &Field, i: usize) -> bool {
    let Some(temporal) = &field.temporal else {
        return true;
    };
    // Farthest from the window centre that the clip gets.
    let reach = f64::from(temporal.tau[i]).abs().max((1.0 - f64::from(temporal.tau[i])).abs());
    let z = reach / f64::from(temporal.s[i]);
    // o (1 - exp(-x)) <= o x: an upper bound without a transcendental function.
    temporal.is_motionless(i) && f64::from(field.opacities[i]) * 0.5 * z * z <= STATIC_OPACITY
}

/// Where Gaussian `i` is in the middle of the time that it is alive.
fn middle_of_life(field: &Field, i: usize) -> [f32; 3] {
    match field.alive_interval(i) {
        Some((start, end)) => field.position_at(i, 0.5 * (start + end)).map(|x| x as f32),
        None => field.centers[i],
    }
}

/// Sorts rows by a key, then by place along a Morton curve through `bounds`, then by importance.
fn sort_by_place(rows: &mut [usize], bounds: [[f32; 3]; 2], place: impl Fn(usize) -> (usize, [f32; 3])) {
    rows.sort_by_cached_key(|&i| {
        let (key, point) = place(i);
        (key, morton(point, bounds), i)
    });
}

/// Position on a Morton curve through `bounds`: 21 bits per axis, interleaved.
fn morton(point: [f32; 3], bounds: [[f32; 3]; 2]) -> u64 {
    let spread = |axis: usize| {
        let (low, high) = (f64::from(bounds[0][axis]), f64::from(bounds[1][axis]));
        // An axis without extent divides zero by zero: NaN, which becomes 0.
        let place = ((f64::from(point[axis]) - low) / (high - low)).clamp(0.0, 1.0);
        let mut x = (place * f64::from((1 << 21) - 1)) as u64;
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    spread(0) | spread(1) << 1 | spread(2) << 2
}

/// Rows per cell as a section's payload and its raw length.
fn time_index_payload(cells: &[u32; CELLS]) -> (Vec<u8>, usize) {
    let mut writer = Writer::default();
    for &count in cells {
        writer.leb128(count);
    }
    let length = writer.bytes.len();
    (writer.bytes, length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_interleaves_the_axes() {
        let bounds = [[0.0; 3], [2_097_151.0; 3]];
        let mut state = 1u64;
        for _ in 0..1000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let point = [state >> 43, state >> 22 & 0x1f_ffff, state >> 7 & 0x1f_ffff];
            let expected = (0..21).fold(0, |code, bit| {
                (0..3).fold(code, |code, axis| code | (point[axis] >> bit & 1) << (3 * bit + axis))
            });
            assert_eq!(morton(point.map(|x| x as f32), bounds), expected, "{point:?}");
        }
    }

    #[test]
    fn morton_takes_flat_bounds_and_points_outside() {
        assert_eq!(morton([1.0; 3], [[1.0; 3]; 2]), 0);
        assert_eq!(morton([-5.0; 3], [[0.0; 3], [1.0; 3]]), 0);
        assert_eq!(morton([5.0; 3], [[0.0; 3], [1.0; 3]]), (1 << 63) - 1);
    }
}
