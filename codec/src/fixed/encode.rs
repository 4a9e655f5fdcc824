//! Encodes chunks with the coder `fixed`.

use super::ranges::{Ranges, raw_bytes};
use crate::{
    ALPHA_MIN, Field, SH_C0,
    bytes::Writer,
    columns::{Columns, TemporalColumns},
    quant::{Range8, Signed, f16_finite, f16_positive, opacity_code, rotation_codes},
    sh_coefficients,
};

/// Level of zstd: the highest that needs no additional memory to decode.
const ZSTD_LEVEL: i32 = 19;

/// Range of the log-scales of a chunk. Axes thinner than e^-16 of the widest are widened to that,
/// which is invisible; the step stays at or below 16 / 255, an error of at most 3.2 % of a scale.
const LOG_SCALE_SPAN: f32 = 16.0;

/// Finest step of a spherical-harmonic coefficient. Rounding all 15 of a channel changes the colour
/// by step / sqrt(12) * sqrt(15 / 4 pi) RMS over all directions: a twelfth of an 8-bit step.
const FINEST_SH: f32 = 1.0 / 1024.0;

/// Finest step of a motion coefficient, relative to the distance of the centres from their median, the farthest 16th left
/// out: 1/512 of an FP16 step there.
const FINEST_MOTION: f32 = 1.0 / 1_048_576.0;

/// Finest step of a rotation rate. Half of it turns a Gaussian less in the whole clip than the
/// rounding of the INT8 quaternion.
const FINEST_RATE: f32 = 1.0 / 512.0;

/// Coefficient of degree 0 of a colour 1.5 away from grey. Colours beyond it are hardly told apart.
const COLOR_MAX: f32 = (1.5 / SH_C0) as f32;

/// Most rows that a range may leave out: one in so many, or one.
const LEFT_OUT: usize = 64;

/// Error that a range must have with its outliers, relative to its error without them, to leave them out.
const OUTLIERS_COST: f32 = 4.0;

/// A number of a column.
#[derive(Clone, Copy)]
struct Number {
    magnitude: f32,
    /// Visible error for an error of 1. A visible error of 1 is as large as any.
    weight: f32,
}

/// The magnitude that the codes of a column of `rows` reach, with a step of `step` for a magnitude of 1. It is the largest
/// of `numbers`, unless a few outliers would make the steps of all others much too large. Magnitudes above `same` all
/// look like it.
fn reach(rows: usize, mut numbers: Vec<Number>, step: f32, same: f32) -> f32 {
    numbers.sort_unstable_by(|a, b| b.magnitude.total_cmp(&a.magnitude));
    let largest = numbers.first().map_or(0.0, |number| number.magnitude);
    let cost = |reach: f32| -> f32 {
        let error = |number: &Number| {
            let beyond = number.magnitude.min(same) - reach;
            let squared = if number.magnitude > reach { beyond.max(0.0).powi(2) } else { 0.0 };
            (number.weight * number.weight * (squared + (step * reach).powi(2) / 12.0)).min(1.0)
        };
        numbers.iter().map(error).sum()
    };
    let left_out = std::iter::successors(Some(1), |rows| Some(2 * rows));
    let left_out = left_out.take_while(|left_out| left_out * LEFT_OUT <= rows.max(LEFT_OUT));
    let smaller = left_out.filter_map(|left_out| numbers.get(left_out * numbers.len() / rows));
    let smaller = smaller.map(|number| number.magnitude).chain([same]);
    let best = smaller
        .filter(|reach| *reach < largest)
        .map(|reach| (cost(reach), reach))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((least, reach)) if OUTLIERS_COST * least < cost(largest) => reach,
        _ => largest,
    }
}

impl Ranges {
    /// Ranges of the columns of `chunk`, which is not empty. A column whose numbers all round to
    /// zero has a step of zero.
    fn over(chunk: &Field) -> Ranges {
        let mut ranges = Ranges::default();
        let rows = chunk.len();
        for axis in 0..3 {
            // The median, so that outliers do not cost the other centres precision.
            let mut column: Vec<f32> = chunk.centers.iter().map(|c| c[axis]).collect();
            let median = *column.select_nth_unstable_by(chunk.len() / 2, f32::total_cmp).1;
            ranges.origin[axis] = median;
            ranges.extent = column.iter().fold(ranges.extent, |extent, x| extent.max((x - median).abs()));
        }
        let visible: Vec<f32> =
            chunk.opacities.iter().map(|o| if f64::from(*o) < ALPHA_MIN { 0.0 } else { *o }).collect();
        ranges.log_scale = Range8::over(chunk.log_scales.iter().flatten().copied(), LOG_SCALE_SPAN);
        let per_row = sh_coefficients(chunk.sh_degree);
        let coefficient = |k: usize| chunk.sh.iter().skip(k).step_by(per_row).flatten().copied();
        let colors = |k: usize| {
            let weights = visible.iter().flat_map(|visible| [SH_C0 as f32 * visible; 3]);
            coefficient(k).zip(weights).map(|(x, weight)| Number { magnitude: x.abs(), weight })
        };
        // From the lowest to the highest, at most twice the reach.
        let dc = reach(rows, colors(0).collect(), 2.0 / 255.0, COLOR_MAX);
        ranges.dc = Range8::over(coefficient(0).map(|x| x.clamp(-dc, dc)), f32::INFINITY);
        for (degree, range) in (1..=chunk.sh_degree).zip(&mut ranges.sh) {
            let band = sh_coefficients(degree - 1)..sh_coefficients(degree);
            let reach = reach(rows, band.flat_map(colors).collect(), Signed::<8>::RELATIVE_STEP, COLOR_MAX);
            *range = Signed::over(reach, FINEST_SH);
        }
        if let Some(temporal) = &chunk.temporal {
            let order = usize::from(temporal.motion_order);
            // Longest time from the centre of the window, and size.
            let lives: Vec<(f32, f32)> = (0..rows)
                .map(|i| {
                    let from_tau = |t: f64| (t - f64::from(temporal.tau[i])).abs() as f32;
                    let time = chunk
                        .alive_interval(i)
                        .map_or(0.0, |(start, end)| from_tau(start).max(from_tau(end)));
                    let size = chunk.log_scales[i].iter().fold(f32::MIN, |size, x| size.max(*x)).min(40.0);
                    (time, libm::expf(size))
                })
                .collect();
            let finest = FINEST_MOTION * spread(chunk, ranges.origin);
            for (power, range) in ranges.motion[..order].iter_mut().enumerate() {
                let values = temporal.motion.iter().skip(power).step_by(order);
                let numbers = values.zip(&lives).flat_map(|(v, (time, size))| {
                    let weight = (0..=power).fold(1.0 / size, |weight, _| weight * time);
                    v.map(|x| Number { magnitude: x.abs(), weight })
                });
                let reach = reach(rows, numbers.collect(), Signed::<10>::RELATIVE_STEP, f32::INFINITY);
                *range = Signed::over(reach, finest);
            }
            let rates = temporal.rotation_rates.iter().flatten().zip(&lives);
            let rates = rates
                .flat_map(|(rate, (time, _))| rate.map(|x| Number { magnitude: x.abs(), weight: *time }));
            let reach = reach(rows, rates.collect(), Signed::<8>::RELATIVE_STEP, f32::INFINITY);
            ranges.rates = Signed::over(reach, FINEST_RATE);
        }
        ranges
    }

    fn write(&self, writer: &mut Writer, columns: Columns) {
        writer.f32x3(self.origin);
        writer.f32(self.extent);
        for range in [self.log_scale, self.dc] {
            writer.f32(range.min);
            writer.f32(range.step);
        }
        for range in &self.sh[..usize::from(columns.sh_degree)] {
            writer.f32(range.step);
        }
        if let Some(temporal) = columns.temporal {
            for range in &self.motion[..usize::from(temporal.motion_order)] {
                writer.f32(range.step);
            }
            if temporal.rotation_rates {
                writer.f32(self.rates.step);
            }
        }
    }
}

/// Largest distance of centres from `origin` along an axis, the farthest 16th of them left out.
fn spread(chunk: &Field, origin: [f32; 3]) -> f32 {
    let distance =
        |c: &[f32; 3]| c.iter().zip(origin).fold(0.0, |most: f32, (x, origin)| most.max((x - origin).abs()));
    let mut distances: Vec<f32> = chunk.centers.iter().map(distance).collect();
    let within = distances.len() - 1 - distances.len() / 16;
    *distances.select_nth_unstable_by(within, f32::total_cmp).1
}

/// The columns in which `chunk` is not zero once coded.
pub(crate) fn nonzero_columns(chunk: &Field) -> Columns {
    let ranges = Ranges::over(chunk);
    let last_used = |used: &[bool]| used.iter().rposition(|used| *used).map_or(0, |i| i as u8 + 1);
    Columns {
        sh_degree: last_used(&ranges.sh.map(|range| range.step != 0.0)),
        temporal: chunk.temporal.as_ref().map(|_| TemporalColumns {
            motion_order: last_used(&ranges.motion.map(|range| range.step != 0.0)),
            rotation_rates: ranges.rates.step != 0.0,
        }),
    }
}

/// Encodes the given columns of `chunk`, which has them all. Also returns the length before
/// compression.
pub(crate) fn encode(chunk: &Field, columns: Columns) -> (Vec<u8>, usize) {
    let raw = encode_raw(chunk, columns);
    debug_assert_eq!(raw.len(), raw_bytes(columns, chunk.len()), "raw_bytes is the length");
    let payload = zstd::bulk::compress(&raw, ZSTD_LEVEL).expect("the buffer has the size zstd asks for");
    (payload, raw.len())
}

/// The columns of one chunk, plane by plane.
struct Planes(Vec<u8>);

impl Planes {
    fn eight(&mut self, codes: impl Iterator<Item = u8>) {
        self.0.extend(codes);
    }

    fn sixteen(&mut self, codes: impl Iterator<Item = u16> + Clone) {
        self.eight(codes.clone().map(|code| (code >> 8) as u8));
        self.eight(codes.map(|code| code as u8));
    }

    fn ten(&mut self, codes: impl Iterator<Item = u16>) {
        let codes: Vec<u16> = codes.collect();
        self.eight(codes.iter().map(|code| (code >> 2) as u8));
        let lower = |four: &[u16]| four.iter().rev().fold(0, |byte, code| byte << 2 | (code & 3) as u8);
        self.eight(codes.chunks(4).map(lower));
    }
}

fn encode_raw(chunk: &Field, columns: Columns) -> Vec<u8> {
    let ranges = Ranges::over(chunk);
    let mut writer = Writer::default();
    ranges.write(&mut writer, columns);
    let mut planes = Planes(writer.bytes);
    for axis in 0..3 {
        let code = |c: &[f32; 3]| match c[axis] - ranges.origin[axis] {
            0.0 => 0,
            offset => f16_finite(offset / ranges.extent),
        };
        planes.sixteen(chunk.centers.iter().map(code));
    }
    for axis in 0..3 {
        planes.eight(chunk.log_scales.iter().map(|scale| ranges.log_scale.code(scale[axis])));
    }
    let rotations: Vec<_> = chunk.rotations.iter().map(|q| rotation_codes(*q)).collect();
    for component in 0..4 {
        planes.eight(rotations.iter().map(|(codes, _)| codes[component]));
    }
    planes.eight(chunk.opacities.iter().map(|opacity| opacity_code(*opacity)));

    let per_row = sh_coefficients(chunk.sh_degree);
    let coefficient = |k: usize| chunk.sh.iter().skip(k).step_by(per_row);
    for channel in 0..3 {
        planes.eight(coefficient(0).map(|c| ranges.dc.code(c[channel])));
    }
    for (degree, range) in (1..=columns.sh_degree).zip(ranges.sh) {
        for k in sh_coefficients(degree - 1)..sh_coefficients(degree) {
            for channel in 0..3 {
                planes.eight(coefficient(k).map(|c| range.code(c[channel]) as u8));
            }
        }
    }

    if let (Some(temporal), Some(columns)) = (&chunk.temporal, columns.temporal) {
        planes.sixteen(temporal.tau.iter().map(|tau| f16_finite(*tau)));
        planes.sixteen(temporal.s.iter().map(|s| f16_positive(*s)));
        let order = usize::from(temporal.motion_order);
        for (power, range) in ranges.motion[..usize::from(columns.motion_order)].iter().enumerate() {
            for axis in 0..3 {
                planes.ten(temporal.motion.iter().skip(power).step_by(order).map(|v| range.code(v[axis])));
            }
        }
        if let (Some(rates), true) = (&temporal.rotation_rates, columns.rotation_rates) {
            for component in 0..4 {
                let code = |(rate, (_, negated)): (&[f32; 4], &([u8; 4], bool))| {
                    // The rate has the sign of the stored quaternion.
                    let sign = if *negated { -1.0 } else { 1.0 };
                    ranges.rates.code(sign * rate[component]) as u8
                };
                planes.eight(rates.iter().zip(&rotations).map(code));
            }
        }
    }
    planes.0
}
