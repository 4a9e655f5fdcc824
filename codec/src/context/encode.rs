//! The writing half of the coder `context`: which class every Gaussian is in, what its numbers
//! are in the coordinates that are coded, and the grid of a chunk.

use super::{
    Chunk, FOOTPRINT, STEP, grid,
    math::{half_octaves, ln, round},
    range::Encoder,
    row::{self, CLASS_BITS, CONTRAST_BITS, LOG_EXTENT_MAX, RowCoder, Target},
    trajectory::{self, Span},
};
use crate::{
    ALPHA_MIN, Field, Limits, MOTION_ORDER_MAX, SH_DEGREE_MAX, Sensitivity,
    bytes::Writer,
    decode::blank_field,
    fixed::{Columns, TemporalColumns},
    limits::Budget,
    rows::Rows,
    sh_coefficients,
};

/// Cells of the grid per step of a middling Gaussian, along an edge.
const CELLS_PER_STEP: f64 = 0.25;

/// Farthest centre of an infinite window, about which a trajectory is written.
const TAU_MAX: f64 = 1e5;

/// What there is to know about the rows of a field before they are cut into chunks.
#[derive(Debug)]
pub(crate) struct Prepared<'a> {
    pub(crate) field: &'a Field,
    /// How visible an error in each row is.
    pub(crate) sensitivities: Vec<Sensitivity>,
    /// Error of a colour allowed at a sensitivity of 1.
    pub(crate) step: f64,
    /// Standard deviation of a point at the resolution to code for.
    pub(crate) footprint: f32,
}

/// The columns of some rows that are not zero throughout, temporal ones only `with_temporal`.
pub(crate) fn columns_needed(field: &Field, rows: &[usize], with_temporal: bool) -> Columns {
    let is_zero = |v: &[f32; 3]| *v == [0.0; 3];
    let has_degree = |degree: &u8| {
        *degree <= field.sh_degree
            && rows.iter().any(|&i| !field.sh_of(i)[sh_coefficients(degree - 1)..].iter().all(is_zero))
    };
    let temporal = field.temporal.as_ref().filter(|_| with_temporal && !rows.is_empty()).map(|temporal| {
        let has_order = |order: &u8| {
            *order <= temporal.motion_order
                && rows.iter().any(|&i| !is_zero(&temporal.motion_of(i)[usize::from(order - 1)]))
        };
        let rates = temporal.rotation_rates.as_ref();
        TemporalColumns {
            motion_order: (1..=MOTION_ORDER_MAX).rev().find(has_order).unwrap_or(0),
            rotation_rates: rates.is_some_and(|rates| rows.iter().any(|&i| rates[i] != [0.0; 4])),
        }
    });
    Columns { sh_degree: (1..=SH_DEGREE_MAX).rev().find(has_degree).unwrap_or(0), temporal }
}

/// A chunk's payload. `rows` of the source are coded; the decoder gets them in another order.
pub(crate) fn encode(source: &Prepared, rows: &[usize], columns: Columns) -> Vec<u8> {
    let footprint = source.footprint.clamp(*FOOTPRINT.start(), *FOOTPRINT.end());
    let finest = rows.iter().map(|&i| half_octaves_of(source.sensitivities[i].color)).min().unwrap_or(0);
    let step = (source.step * octaves(finest)).clamp(f64::from(*STEP.start()), f64::from(*STEP.end())) as f32;

    let prepare = |&i: &usize| {
        let Sensitivity { color, geometry } = source.sensitivities[i];
        let class = (half_octaves_of(color) - finest).clamp(0, (1 << CLASS_BITS) - 1) as u32;
        let contrast =
            (half_octaves_of(geometry) - half_octaves_of(color)).clamp(0, (1 << CONTRAST_BITS) - 1) as u32;
        let step = f64::from(step) * half_octaves(class) * half_octaves(contrast);
        let mut wanted = wanted(source.field, i, step, columns);
        (wanted.class, wanted.contrast) = (class, contrast);
        wanted
    };
    let wanted: Vec<Target> = rows.iter().map(prepare).collect();
    let mut chunk = Chunk { step, footprint, origin: [0.0; 3], cell_size: 0.0, axis_bits: 0 };
    lay_grid(&mut chunk, &wanted);

    let mut order: Vec<(u64, &Target)> =
        wanted.iter().map(|wanted| (cell_of(&chunk, wanted.trajectory[0]), wanted)).collect();
    // Rows of one cell keep the order they come in.
    order.sort_by_key(|(cell, _)| *cell);
    let mut writer = Writer::default();
    chunk.write(&mut writer);
    let mut encoder = Encoder::new(writer.bytes);
    let mut cells: Vec<u64> = order.iter().map(|(cell, _)| *cell).collect();
    grid::code(&mut encoder, u32::from(chunk.axis_bits), &mut cells);
    let mut coder = RowCoder::new(&chunk, columns);
    let mut expected = cfg!(debug_assertions).then(|| blank(columns, rows.len()));
    for (i, (cell, wanted)) in order.into_iter().enumerate() {
        let row = coder.code(&mut encoder, grid::cell(cell), Some(wanted));
        let row = row.expect("the numbers of a valid field can be coded");
        if let Some(expected) = &mut expected {
            row.write_to(&mut Rows::of(expected), i);
        }
    }
    let payload = encoder.finish();
    if let Some(expected) = expected {
        let mut decoded = blank(columns, rows.len());
        super::decode(&payload, columns, 0, Rows::of(&mut decoded)).expect("what was encoded decodes");
        assert!(decoded == expected, "the decoder gets what the encoder told");
    }
    payload
}

/// Rows of zeros.
fn blank(columns: Columns, rows: usize) -> Field {
    let mut budget = Budget::new(&Limits::default());
    blank_field(columns, rows, &mut budget).expect("a chunk is small")
}

/// Half octaves that a sensitivity is below 1.
fn half_octaves_of(sensitivity: f32) -> i32 {
    let x = f64::from(sensitivity).clamp(1e-12, 1e12);
    round(-2.0 * ln(x) / std::f64::consts::LN_2) as i32
}

/// 2 to the power of `halves / 2`.
fn octaves(halves: i32) -> f64 {
    if halves < 0 { 1.0 / half_octaves(halves.unsigned_abs()) } else { half_octaves(halves.unsigned_abs()) }
}

/// Row `i` in the coordinates that are coded, for a geometry step of `step`.
fn wanted<'a>(field: &'a Field, i: usize, step: f64, columns: Columns) -> Target<'a> {
    let multiple = |number: f64, step: f64| round(number / step) * step;

    let opacity = f64::from(field.opacities[i]);
    let unit = row::opacity_step(step);
    // Half the least visible opacity stands for all that cannot be seen.
    let mut number = multiple(-ln(opacity.max(0.5 * ALPHA_MIN)), unit);
    let is_alive = |number: f64| f64::from(row::decoded_opacity(number)) >= ALPHA_MIN;
    // What was just visible stays so, what was not does not become so.
    if opacity >= ALPHA_MIN && !is_alive(number) {
        number -= unit;
    } else if opacity < ALPHA_MIN && is_alive(number) {
        number += unit;
    }
    let mut window = [number, 0.0, 0.0];
    let opacity = f64::from(row::decoded_opacity(number));

    let (mut rotation, mut rate) = (field.rotations[i].map(f64::from), [0.0; 4]);
    let mut trajectory = [[0.0; 3]; 4];
    trajectory[0] = field.centers[i].map(f64::from);
    if let (Some(temporal), Some(_)) = (&field.temporal, columns.temporal) {
        let mut tau = f64::from(temporal.tau[i]);
        window[1] =
            multiple(trajectory::width_number(f64::from(temporal.s[i])), trajectory::width_step(step));
        let s = trajectory::width(window[1]) as f32;
        let mut decoded_tau = 0.5f32;
        if s.is_infinite() {
            // As far from the clip as an infinite window can be told from one that is not.
            tau = tau.clamp(-TAU_MAX, TAU_MAX);
        } else {
            let s = f64::from(s);
            // Beyond 4 widths from the clip nothing is alive.
            tau = tau.clamp(-4.0 * s, 1.0 + 4.0 * s);
            window[2] = multiple(tau - 0.5, trajectory::center_step(s, step));
            decoded_tau = row::decoded_tau(window[2]);
        }
        let span = Span::new(opacity, f64::from(decoded_tau), f64::from(s));
        for axis in 0..3 {
            let mut powers = [trajectory[0][axis], 0.0, 0.0, 0.0];
            for (power, v) in powers[1..].iter_mut().zip(temporal.motion_of(i)) {
                *power = f64::from(v[axis]);
            }
            let c = span.orthogonal(powers, tau);
            (0..4).for_each(|k| trajectory[k][axis] = c[k]);
        }
        if let Some(rates) = &temporal.rotation_rates {
            // The rate is that of the quaternion as it is; the decoded one has another tau.
            rate = rates[i].map(f64::from);
            (0..4).for_each(|k| rotation[k] += rate[k] * (f64::from(decoded_tau) - tau));
        }
    }
    let norm = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
    // A rate can pass exactly through zero; any fixed rotation will do at that instant.
    (rotation, rate) = match norm > 1e-12 {
        true => (rotation.map(|x| x / norm), rate.map(|x| x / norm)),
        false => ([1.0, 0.0, 0.0, 0.0], [0.0; 4]),
    };

    let columns_of =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| super::rotation::turn(rotation, e));
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| field.log_scales[i][b].total_cmp(&field.log_scales[i][a]));
    Target {
        class: 0,
        contrast: 0,
        window,
        log_scales: axes.map(|axis| f64::from(field.log_scales[i][axis]).min(LOG_EXTENT_MAX - 4.0)),
        axes: axes.map(|axis| columns_of[axis]),
        trajectory,
        spin: row::spin(rotation, rate),
        sh: field.sh_of(i),
    }
}

/// Chooses the grid of a chunk: a cube around its Gaussians, its cells about as large as the
/// position step of a middling one.
fn lay_grid(chunk: &mut Chunk, wanted: &[Target]) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for w in wanted {
        for axis in 0..3 {
            low[axis] = low[axis].min(w.trajectory[0][axis]);
            high[axis] = high[axis].max(w.trajectory[0][axis]);
        }
    }
    let size = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let mut units: Vec<f64> = wanted.iter().map(|w| row::position_step(chunk, w)).collect();
    let middle = units.len() / 2;
    let unit = *units.select_nth_unstable_by(middle, f64::total_cmp).1 / CELLS_PER_STEP;
    let mut bits = 0;
    while bits < grid::AXIS_BITS_MAX && size > unit * f64::from(1u32 << bits) {
        bits += 1;
    }
    chunk.origin = low.map(|x| x as f32);
    // A little larger than needed, for the rounding of the origin.
    chunk.cell_size = (size * (1.0 + 1e-6) / f64::from(1u32 << bits)) as f32;
    chunk.axis_bits = bits as u8;
}

/// Morton number of the cell of a point.
fn cell_of(chunk: &Chunk, point: [f64; 3]) -> u64 {
    let last = f64::from((1u32 << chunk.axis_bits) - 1);
    grid::morton([0, 1, 2].map(|axis| {
        // A grid without extent divides zero by zero: NaN, which becomes 0.
        let place = (point[axis] - f64::from(chunk.origin[axis])) / f64::from(chunk.cell_size);
        place.floor().clamp(0.0, last) as u32
    }))
}
