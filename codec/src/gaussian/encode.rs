//! Encodes chunks: chooses quantiser indices and the grid, and converts Gaussians to the coordinates that
//! are coded.

use super::{
    chunk::{Chunk, FOOTPRINT, STEP},
    decode::decode,
    grid,
    indices::{self, Indices},
    rotation,
    row::{self, GEOMETRY_BITS, LOG_EXTENT_MAX, RowCoder, Target, VISIBILITY_BITS},
    trajectory::{self, Span},
};
use crate::{
    ALPHA_MIN, Field, Limits, Sensitivity, Temporal,
    bytes::Writer,
    columns::Columns,
    limits::Budget,
    morton::{deinterleave, interleave},
    precision::Prepared,
    rans::{
        Encoder,
        math::{self, half_octaves},
    },
    rows::Rows,
    sh_coefficients,
};

/// Cells per position step of a median Gaussian, along an edge.
const CELLS_PER_STEP: f64 = 0.25;

/// Instants at which windows are compared that are centred outside the clip.
const INSTANTS: usize = 9;

/// The choices for a chunk of an earlier package.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ChunkForm<'a> {
    /// Whether neighbours predict; `None` to code both ways.
    pub(crate) has_neighbors: Option<bool>,
    /// Steps of the Gaussians; `None` to choose them.
    pub(crate) steps: Option<&'a [Steps]>,
}

/// Colour step and geometry step of a Gaussian, in half octaves.
pub(crate) type Steps = [i32; 2];

/// A chunk of a package.
#[derive(Clone, Debug)]
pub(crate) struct EncodedChunk {
    /// Source rows of the Gaussians, in coded order.
    pub(crate) rows: Vec<usize>,
    /// Steps of the Gaussians of these rows.
    pub(crate) steps: Vec<Steps>,
    /// Whether neighbours predict.
    pub(crate) has_neighbors: bool,
    /// The bytes of the section.
    pub(crate) payload: Vec<u8>,
}

/// Encodes `rows` of a field as a chunk, which orders them by grid cell. The steps of `form`, if given, are by row of
/// the field.
pub(crate) fn encode(source: &Prepared, rows: &[usize], columns: Columns, form: ChunkForm) -> EncodedChunk {
    let footprint = source.footprint.clamp(*FOOTPRINT.start(), *FOOTPRINT.end());
    let finest_color = |&i: &usize| half_octaves_below_1(source.sensitivities[i].color);
    let finest = rows.iter().map(finest_color).map(math::round).fold(f64::INFINITY, f64::min);
    let finest = if rows.is_empty() { 0 } else { finest as i32 };
    let step =
        (source.step * half_octaves_signed(finest)).clamp(f64::from(*STEP.start()), f64::from(*STEP.end()));
    let mut chunk = Chunk {
        step: step as f32,
        footprint,
        origin: [0.0; 3],
        cell_size: 0.0,
        axis_bits: 0,
        has_neighbors: true,
    };

    let indices = match form.steps {
        Some(steps) => rows.iter().map(|&i| indices_of(steps[i], finest)).collect(),
        None => choose_indices(source, rows, columns, &mut chunk, finest),
    };
    let targets = targets(source, rows, columns, &chunk, &indices);
    let order = in_order(&mut chunk, &targets);
    let targets_in_order: Vec<(u64, &Target)> =
        order.iter().map(|&(cell, at)| (cell, &targets[at])).collect();
    let coded = |has_neighbors| {
        let chunk = Chunk { has_neighbors, ..chunk.clone() };
        (has_neighbors, encode_ordered(&chunk, &targets_in_order, columns))
    };
    let choices = form.has_neighbors.map_or(vec![true, false], |only| vec![only]);
    // Of forms of the same length the first one.
    let shortest = choices.into_iter().map(coded).min_by_key(|(_, payload)| payload.len());
    let (has_neighbors, payload) = shortest.expect("there is a choice");
    let steps = order.iter().map(|&(_, at)| steps_of(indices[at], finest)).collect();
    let rows = order.iter().map(|&(_, at)| rows[at]).collect();
    EncodedChunk { rows, steps, has_neighbors, payload }
}

/// Chooses the quantiser indices of rows, along the order that they have with the nearest ones.
fn choose_indices(
    source: &Prepared,
    rows: &[usize],
    columns: Columns,
    chunk: &mut Chunk,
    finest: i32,
) -> Vec<Indices> {
    let ideal: Vec<[f64; 2]> = rows
        .iter()
        .map(|&i| {
            let Sensitivity { color, geometry } = source.sensitivities[i];
            [color, geometry].map(|number| half_octaves_below_1(number) - f64::from(finest))
        })
        .collect();
    let nearest: Vec<Indices> = ideal.iter().map(|&ideal| indices::nearest(ideal)).collect();
    let order = in_order(chunk, &targets(source, rows, columns, chunk, &nearest));
    let ideal: Vec<[f64; 2]> = order.iter().map(|&(_, at)| ideal[at]).collect();
    let mut chosen = nearest;
    for (&(_, at), indices) in order.iter().zip(indices::choose(&ideal, numbers_of(columns))) {
        chosen[at] = indices;
    }
    chosen
}

/// How many numbers of a Gaussian are coded with its colour step and with its geometry step. Half of the motion and of
/// the spherical harmonics are smaller than a step, and do not count.
fn numbers_of(columns: Columns) -> [f64; 2] {
    let harmonics = 3 * (sh_coefficients(columns.sh_degree) - 1);
    let temporal = columns.temporal.map_or(0, |temporal| {
        2 + 3 * usize::from(temporal.motion_order) + if temporal.rotation_rates { 4 } else { 0 }
    });
    [3.0 + 0.5 * harmonics as f64, 10.0 + 0.5 * temporal as f64]
}

/// The steps of indices in a chunk whose finest colour step is `finest`.
fn steps_of([visibility, geometry]: Indices, finest: i32) -> Steps {
    let color = finest + visibility as i32;
    [color, color + geometry as i32]
}

/// The indices of steps in a chunk whose finest colour step is `finest`, cut to their range.
fn indices_of([color, geometry]: Steps, finest: i32) -> Indices {
    let visibility = (color - finest).clamp(0, (1 << VISIBILITY_BITS) - 1);
    let geometry = (geometry - finest - visibility).clamp(0, (1 << GEOMETRY_BITS) - 1);
    [visibility as u32, geometry as u32]
}

/// Converts rows to the coordinates that are coded.
fn targets<'a>(
    source: &Prepared<'a>,
    rows: &[usize],
    columns: Columns,
    chunk: &Chunk,
    indices: &[Indices],
) -> Vec<Target<'a>> {
    let target = |(&i, &[visibility_index, geometry_index]): (&usize, &Indices)| {
        let step = f64::from(chunk.step) * half_octaves(visibility_index) * half_octaves(geometry_index);
        Target { visibility_index, geometry_index, ..target(source.field, i, step, columns) }
    };
    rows.iter().zip(indices).map(target).collect()
}

/// Chooses the grid of a chunk; returns the cell and the place of each target, in the order of the cells.
fn in_order(chunk: &mut Chunk, targets: &[Target]) -> Vec<(u64, usize)> {
    choose_grid(chunk, targets);
    let cells = targets.iter().map(|target| cell_of(chunk, target.trajectory[0]));
    let mut order: Vec<(u64, usize)> = cells.zip(0..).collect();
    // Within a cell, the order follows the targets.
    order.sort_unstable();
    order
}

/// The payload of a chunk of these targets, which are in the order of their cells.
fn encode_ordered(chunk: &Chunk, order: &[(u64, &Target)], columns: Columns) -> Vec<u8> {
    let mut encoder = Encoder::default();
    let mut cells: Vec<u64> = order.iter().map(|(cell, _)| *cell).collect();
    grid::code(&mut encoder, u32::from(chunk.axis_bits), &mut cells);
    let mut coder = RowCoder::new(chunk, columns);
    let zeros =
        || columns.zeros(order.len(), &mut Budget::new(&Limits::default())).expect("a chunk is small");
    let mut expected = cfg!(debug_assertions).then(zeros);
    for (i, &(cell, target)) in order.iter().enumerate() {
        let row = coder.code(&mut encoder, deinterleave(cell), Some(target));
        let row = row.expect("the numbers of a valid field can be coded");
        if let Some(expected) = &mut expected {
            row.write_to(&mut Rows::all(expected), i);
        }
    }
    let mut writer = Writer::default();
    chunk.write(&mut writer);
    writer.bytes.extend_from_slice(&encoder.finish());
    if let Some(expected) = expected {
        let mut decoded = zeros();
        decode(&writer.bytes, columns, 0, Rows::all(&mut decoded)).expect("an encoded chunk decodes");
        assert!(decoded == expected, "the decoder returns the rows that the encoder computed");
    }
    writer.bytes
}

/// Half octaves from a sensitivity up to 1.
fn half_octaves_below_1(sensitivity: f32) -> f64 {
    let x = f64::from(sensitivity).clamp(1e-12, 1e12);
    -2.0 * math::ln(x) / std::f64::consts::LN_2
}

/// `2^(halves / 2)`.
fn half_octaves_signed(halves: i32) -> f64 {
    let magnitude = half_octaves(halves.unsigned_abs());
    if halves < 0 { 1.0 / magnitude } else { magnitude }
}

/// The multiple of `step` nearest to `number`.
fn multiple(number: f64, step: f64) -> f64 {
    math::round(number / step) * step
}

/// Converts row `i` to the coordinates that are coded, for a geometry step of `step`, without
/// quantiser indices.
fn target<'a>(field: &'a Field, i: usize, step: f64, columns: Columns) -> Target<'a> {
    let mut window = [opacity_number(f64::from(field.opacities[i]), row::opacity_step(step)), 0.0, 0.0];
    let (mut rotation, mut rate) = (field.rotations[i].map(f64::from), [0.0; 4]);
    let mut trajectory = [[0.0; 3]; 4];
    trajectory[0] = field.centers[i].map(f64::from);
    if let (Some(temporal), Some(_)) = (&field.temporal, columns.temporal) {
        let (coded, tau) = coded_window(field, temporal, i, step);
        window = coded.numbers;
        let decoded_tau = coded.tau;
        let span = Span::new(coded.opacity, coded.tau, coded.s);
        for axis in 0..3 {
            let mut powers = [trajectory[0][axis], 0.0, 0.0, 0.0];
            for (power, v) in powers[1..].iter_mut().zip(temporal.motion_of(i)) {
                *power = f64::from(v[axis]);
            }
            let c = span.orthogonal(powers, tau);
            (0..4).for_each(|k| trajectory[k][axis] = c[k]);
        }
        let is_codable = trajectory.as_flattened().iter().all(|x| x.abs() < f64::from(f32::MAX));
        if !is_codable && field.alive_interval(i).is_none() {
            // The clip never shows it: it may stay at its centre.
            trajectory = [field.centers[i].map(f64::from), [0.0; 3], [0.0; 3], [0.0; 3]];
        }
        if let Some(rates) = &temporal.rotation_rates {
            // The coded quaternion is the rotation at the decoded tau.
            rate = rates[i].map(f64::from);
            (0..4).for_each(|k| rotation[k] += rate[k] * (decoded_tau - tau));
        }
    }
    let norm = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
    // The sum can be zero at one instant; any rotation will do there.
    (rotation, rate) = match norm > 1e-12 {
        true => (rotation.map(|x| x / norm), rate.map(|x| x / norm)),
        false => ([1.0, 0.0, 0.0, 0.0], [0.0; 4]),
    };

    let world_axes =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| rotation::rotate(rotation, e));
    let mut by_width = [0, 1, 2];
    by_width.sort_by(|&a, &b| field.log_scales[i][b].total_cmp(&field.log_scales[i][a]));
    Target {
        visibility_index: 0,
        geometry_index: 0,
        window,
        log_scales: by_width.map(|axis| f64::from(field.log_scales[i][axis]).min(LOG_EXTENT_MAX - 4.0)),
        axes: by_width.map(|axis| world_axes[axis]),
        trajectory,
        angular_rate: row::angular_rate(rotation, rate),
        sh: field.sh_of(i),
    }
}

/// The coded number of an opacity: a multiple of `step`. Rounding makes no visible Gaussian
/// invisible, and no invisible one visible.
fn opacity_number(opacity: f64, step: f64) -> f64 {
    // All invisible opacities are coded as half the least visible one.
    let number = multiple(-math::ln(opacity.max(0.5 * ALPHA_MIN)), step);
    let is_visible = f64::from(row::decoded_opacity(number)) >= ALPHA_MIN;
    match (opacity >= ALPHA_MIN, is_visible) {
        (true, false) => number - step,
        (false, true) => number + step,
        _ => number,
    }
}

/// Opacity and window of a Gaussian: the numbers that are coded, and what they decode to.
#[derive(Clone, Copy)]
struct CodedWindow {
    /// As in [`Target::window`].
    numbers: [f64; 3],
    opacity: f64,
    tau: f64,
    s: f64,
}

impl CodedWindow {
    /// The window of these numbers, the centre rounded to a multiple of its step.
    fn new([opacity, width, center]: [f64; 3], step: f64) -> CodedWindow {
        let s = f64::from(trajectory::width(width) as f32);
        let center = match s.is_finite() {
            true => multiple(center, trajectory::center_step(s, step)),
            false => 0.0,
        };
        CodedWindow {
            numbers: [opacity, width, center],
            opacity: f64::from(row::decoded_opacity(opacity)),
            tau: f64::from(row::decoded_tau(center)),
            s,
        }
    }

    /// The opacity at an instant, for each unit of the opacity.
    fn share(&self, t: f64) -> f64 {
        let z = (t - self.tau) / self.s;
        math::exp(-0.5 * z * z)
    }
}

/// The coded opacity and window of row `i`, and the centre about which its trajectory is written.
fn coded_window(field: &Field, temporal: &Temporal, i: usize, step: f64) -> (CodedWindow, f64) {
    let (tau, s) = (f64::from(temporal.tau[i]), f64::from(temporal.s[i]));
    let opacity = opacity_number(f64::from(field.opacities[i]), row::opacity_step(step));
    let width_step = trajectory::width_step(step);
    let width = trajectory::width_number(s);
    // A window narrower than all codes keeps its centre, which would move far to keep the slope.
    if s.is_finite()
        && s >= trajectory::narrowest()
        && !(0.0..=1.0).contains(&tau)
        && let Some(interval) = field.alive_interval(i)
    {
        return (tail(field, i, interval, width / width_step, step), tau);
    }
    let coded = CodedWindow::new([opacity, multiple(width, width_step), tau - 0.5], step);
    if coded.s.is_infinite() {
        return (coded, tau);
    }
    // Farther than 4 widths from the clip no opacity is visible.
    let tau = tau.clamp(-4.0 * coded.s, 1.0 + 4.0 * coded.s);
    (CodedWindow::new([opacity, coded.numbers[1], tau - 0.5], step), tau)
}

/// The coded window of a row whose window is centred outside the clip, which shows a tail of it alone during `interval`. An
/// error of the width or the centre shows many times larger there than at the centre, so the centre makes up for the
/// rounding of the width, and the opacity for both. `width` is in steps.
fn tail(field: &Field, i: usize, (start, end): (f64, f64), width: f64, step: f64) -> CodedWindow {
    let temporal = field.temporal.as_ref().expect("the row has a window");
    let (tau, s) = (f64::from(temporal.tau[i]), f64::from(temporal.s[i]));
    let instants: [f64; INSTANTS] =
        std::array::from_fn(|k| start + (end - start) * (k as f64 + 0.5) / INSTANTS as f64);
    let shown = instants.map(|t| {
        let z = (t - tau) / s;
        f64::from(field.opacities[i]) * math::exp(-0.5 * z * z)
    });
    let sum = |term: &dyn Fn(usize) -> f64| (0..INSTANTS).map(term).sum::<f64>();
    let middle = sum(&|k| shown[k] * shown[k] * instants[k]) / sum(&|k| shown[k] * shown[k]);
    let (width_step, opacity_step) = (trajectory::width_step(step), row::opacity_step(step));
    let mut best: Option<(f64, CodedWindow)> = None;
    for width in [width.floor(), width.ceil()].map(|steps| steps * width_step) {
        let s_coded = f64::from(trajectory::width(width) as f32);
        // The slope of the logarithm of the opacity is as in the source.
        let center = middle - (middle - tau) * (s_coded / s) * (s_coded / s) - 0.5;
        let center_step = trajectory::center_step(s_coded, step);
        for center in if s_coded.is_finite() {
            [(center / center_step).floor(), (center / center_step).ceil()].map(|steps| steps * center_step)
        } else {
            [0.0; 2]
        } {
            let window = CodedWindow::new([0.0, width, center], step);
            // The mean logarithm, weighted as the square of what shows, is as in the source.
            let weighted =
                |k: usize| shown[k] * shown[k] * (math::ln(window.share(instants[k])) - math::ln(shown[k]));
            let opacity = sum(&weighted) / sum(&|k| shown[k] * shown[k]);
            let opacity = opacity_number(math::exp(-opacity.max(0.0)), opacity_step);
            let window = CodedWindow::new([opacity, width, center], step);
            let error = sum(&|k| {
                let error = window.opacity * window.share(instants[k]) - shown[k];
                error * error
            });
            if best.as_ref().is_none_or(|(least, _)| error < *least) {
                best = Some((error, window));
            }
        }
    }
    best.expect("there are candidates").1
}

/// Chooses the grid of a chunk: a cube around its Gaussians, with cells of a few position steps of a
/// median Gaussian.
fn choose_grid(chunk: &mut Chunk, targets: &[Target]) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for target in targets {
        for axis in 0..3 {
            low[axis] = low[axis].min(target.trajectory[0][axis]);
            high[axis] = high[axis].max(target.trajectory[0][axis]);
        }
    }
    let size = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let mut steps: Vec<f64> = targets.iter().map(|target| row::position_step(chunk, target)).collect();
    let median = steps.len() / 2;
    let cell_size = *steps.select_nth_unstable_by(median, f64::total_cmp).1 / CELLS_PER_STEP;
    let mut bits = 0;
    while bits < grid::AXIS_BITS_MAX && size > cell_size * f64::from(1u32 << bits) {
        bits += 1;
    }
    chunk.origin = low.map(|x| x as f32);
    // The margin covers the rounding of the origin.
    chunk.cell_size = (size * (1.0 + 1e-6) / f64::from(1u32 << bits)) as f32;
    chunk.axis_bits = bits as u8;
}

/// Morton number of the cell of a point.
fn cell_of(chunk: &Chunk, point: [f64; 3]) -> u64 {
    let last = f64::from((1u32 << chunk.axis_bits) - 1);
    interleave([0, 1, 2].map(|axis| {
        // A grid without extent gives 0 / 0: NaN, which becomes 0.
        let position = (point[axis] - f64::from(chunk.origin[axis])) / f64::from(chunk.cell_size);
        position.floor().clamp(0.0, last) as u32
    }))
}
