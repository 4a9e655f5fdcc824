//! Packs the Gaussians of a clip into the records that the stage `evaluate` reads.
//!
//! The precision of each quantity keeps its error on screen below a tenth of an 8-bit step, for windows and
//! motion below a fifth, see [`moment`]; the tests of this module check the bounds. Scales, motion and
//! brightness are clamped to the range of the record.

pub(in crate::gpu) mod moment;

use codec::{Field, PixelFilter};
use glam::DVec3;
use half::f16;
use shaders::layout::{Gaussian, Ranges};
use shaders::{Features, Motion, sh_words};

use moment::Moment;

/// Log-scales are clamped to plus or minus this: 2e-9 to 5e8 units.
const LOG_SCALE_LIMIT: f32 = 20.0;

/// Number of centres sampled to find the origin of a clip.
const ORIGIN_ROWS: usize = 1000;

/// The records of a clip, or of a segment, static rows first.
pub(crate) struct Packed {
    pub(crate) features: Features,
    pub(crate) ranges: Ranges,
    pub(crate) gaussians: Vec<Gaussian>,
    /// [`Motion::words`] per dynamic row.
    pub(crate) motion: Vec<u32>,
    /// [`sh_words`] per row.
    pub(crate) sh: Vec<u32>,
}

impl Packed {
    /// Bytes of all columns.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.gaussians[..]) + size_of_val(&self.motion[..]) + size_of_val(&self.sh[..])
    }
}

/// The origin of a clip: the median centre per axis. Packed centres are relative to it, so the precision does
/// not depend on the distance from the origin of the world, and only outliers lose precision.
pub(crate) fn origin(static_field: &Field, dynamic_field: &Field) -> DVec3 {
    let position = |row: usize| match (row.checked_sub(static_field.len()), &dynamic_field.temporal) {
        (None, _) => static_field.centers[row].map(f64::from),
        (Some(row), None) => dynamic_field.centers[row].map(f64::from),
        (Some(row), Some(temporal)) => Moment::of(dynamic_field, temporal, row).position,
    };
    let rows = static_field.len() + dynamic_field.len();
    let mut positions: Vec<[f64; 3]> =
        (0..rows).step_by(rows.div_ceil(ORIGIN_ROWS).max(1)).map(position).collect();
    if positions.is_empty() {
        return DVec3::ZERO;
    }
    let half = positions.len() / 2;
    let median =
        |axis: usize| positions.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis])).1[axis];
    let origin = DVec3::from_array([0, 1, 2].map(median));
    if origin.is_finite() { origin } else { DVec3::ZERO }
}

/// The features that shaders need for both fields.
pub(crate) fn features([static_field, dynamic_field]: [&Field; 2]) -> Features {
    let temporal = dynamic_field.temporal.as_ref().filter(|_| !dynamic_field.is_empty());
    let motion = temporal
        .map(|temporal| Motion { order: temporal.motion_order, rotates: temporal.rotation_rates.is_some() });
    let sh_degree = [static_field, dynamic_field]
        .into_iter()
        .filter(|field| !field.is_empty())
        .map(|field| field.sh_degree);
    let field = if dynamic_field.is_empty() { static_field } else { dynamic_field };
    let mip = field.filter == PixelFilter::Mip;
    Features { sh_degree: sh_degree.max().unwrap_or(0), motion, mip, segmented: false }
}

/// Packs `static_field`, whose temporal columns are ignored, followed by `dynamic_field`, with centres relative to
/// `origin`, for shaders with `features`: at least those of the fields. What a field lacks of them is 0.
pub(crate) fn pack([static_field, dynamic_field]: [&Field; 2], origin: DVec3, features: Features) -> Packed {
    let motion = features.motion;
    let temporal = dynamic_field.temporal.as_ref().filter(|_| !dynamic_field.is_empty());
    let moments: Vec<Moment> = temporal.map_or_else(Vec::new, |temporal| {
        (0..dynamic_field.len()).map(|row| Moment::of(dynamic_field, temporal, row)).collect()
    });
    let ranges = ranges(static_field, dynamic_field, &moments);

    let mut packed = Packed {
        features,
        ranges,
        gaussians: Vec::with_capacity(static_field.len() + dynamic_field.len()),
        motion: Vec::with_capacity(motion.map_or(0, |motion| motion.words() * dynamic_field.len())),
        sh: Vec::with_capacity(sh_words(features.sh_degree) * (static_field.len() + dynamic_field.len())),
    };
    for (field, moments) in [(static_field, &[][..]), (dynamic_field, &moments)] {
        for row in 0..field.len() {
            let moment = moments.get(row);
            let (center, rotation) = match moment {
                Some(moment) => (moment.position, moment.rotation),
                None => (field.centers[row].map(f64::from), field.rotations[row].map(f64::from)),
            };
            let rotation = normalized(rotation);
            let center = DVec3::from_array(center) - origin;
            packed.gaussians.push(pack_gaussian(field, row, center, rotation, &ranges));
            if let Some((moment, motion)) = moment.zip(motion) {
                pack_motion(moment, motion, rotation, &ranges, &mut packed.motion);
            }
            if features.sh_degree > 0 {
                pack_sh(&field.sh_of(row)[1..], features.sh_degree, &mut packed.sh);
            }
        }
    }
    packed
}

/// `q` normalised; the identity if its length is 0 or not finite.
fn normalized(q: [f64; 4]) -> [f32; 4] {
    let length = moment::length(q);
    if length > 0.0 && length.is_finite() { q.map(|x| (x / length) as f32) } else { [1.0, 0.0, 0.0, 0.0] }
}

fn ranges(static_field: &Field, dynamic_field: &Field, moments: &[Moment]) -> Ranges {
    let scales = || {
        static_field
            .log_scales
            .iter()
            .chain(&dynamic_field.log_scales)
            .flatten()
            .copied()
            .map(clamp_log_scale)
    };
    let (low, high) = scales().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
    let mut ranges = Ranges {
        log_scale_min: low,
        log_scale_step: (high - low) / 65535.0,
        first_dynamic: u32::try_from(static_field.len()).expect("buffer limits are checked before"),
        rate_unit: 1.0,
        motion_units: [1.0; 3],
        _pad0: 0.0,
    };
    if !moments.is_empty() {
        let (mut motion, mut rate) = ([0f32; 3], 0f32);
        let largest = |values: &[f32], largest: f32| values.iter().fold(largest, |l, x| l.max(x.abs()));
        for moment in moments {
            motion.iter_mut().zip(&moment.motion).for_each(|(l, w)| *l = largest(w, *l));
            rate = largest(&moment.rates, rate);
        }
        (ranges.motion_units, ranges.rate_unit) = (motion.map(unit), unit(rate));
    }
    ranges
}

fn clamp_log_scale(log_scale: f32) -> f32 {
    log_scale.clamp(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT)
}

/// A power of two that scales `largest` near the top of the range of f16. A power of two is exact, and
/// small numbers stay normal.
fn unit(largest: f32) -> f32 {
    if largest == 0.0 { 1.0 } else { 2f32.powi((largest.log2().ceil() as i32 - 15).max(-100)) }
}

fn pack_gaussian(field: &Field, row: usize, center: DVec3, rotation: [f32; 4], ranges: &Ranges) -> Gaussian {
    let scale = |axis: usize| {
        let above = clamp_log_scale(field.log_scales[row][axis]) - ranges.log_scale_min;
        if ranges.log_scale_step > 0.0 { (above / ranges.log_scale_step).round() as u32 } else { 0 }
    };
    let [a, b, c, largest] = pack_rotation(rotation);
    let base = base_color(field, row).map(half_bits);
    let opacity = (field.opacities[row] * 65535.0).round() as u32;
    Gaussian {
        center: center.as_vec3().to_array().map(f32::to_bits),
        rotation: a & 0x7fff | (b & 0x7fff) << 15 | largest << 30,
        rotation_scale: c & 0xffff | scale(0) << 16,
        scales: scale(1) | scale(2) << 16,
        opacity_red: opacity | base[0] << 16,
        green_blue: base[1] | base[2] << 16,
    }
}

/// View-independent colour: `0.5 + Y_0 c_0`.
fn base_color(field: &Field, row: usize) -> [f32; 3] {
    let y0 = 0.5 / std::f32::consts::PI.sqrt();
    field.sh_of(row)[0].map(|c| 0.5 + y0 * c)
}

/// Index of the first largest component of `q`, and its sign: the packed quaternion is `q` times the sign.
fn largest_component(q: [f32; 4]) -> (usize, f32) {
    let largest = (1..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    (largest, 1f32.copysign(q[largest]))
}

/// The three smaller components as signed integers of 15, 15 and 16 bits, and the index of the omitted one.
fn pack_rotation(q: [f32; 4]) -> [u32; 4] {
    let (largest, sign) = largest_component(q);
    let mut small = (0..4).filter(|&k| k != largest).map(|k| q[k] * sign * std::f32::consts::SQRT_2);
    let mut next = |steps: f32| (small.next().unwrap_or(0.0).clamp(-1.0, 1.0) * steps).round() as i32 as u32;
    [next(16383.0), next(16383.0), next(32767.0), largest as u32]
}

fn half_bits(value: f32) -> u32 {
    let largest = f16::MAX.to_f32();
    u32::from(f16::from_f32(value.clamp(-largest, largest)).to_bits())
}

fn pack_motion(moment: &Moment, features: Motion, rotation: [f32; 4], ranges: &Ranges, words: &mut Vec<u32>) {
    words.push(u32::from(moment.instant) | u32::from(moment.z as u16) << 16);
    let mut halves = [0u32; 14];
    halves[0] = u32::from(moment.widths.to_bits());
    let mut count = 1;
    let mut push = |value: f32| {
        halves[count] = half_bits(value);
        count += 1;
    };
    for (w, unit) in moment.motion.iter().zip(ranges.motion_units).take(features.order.into()) {
        w.iter().for_each(|x| push(x / unit));
    }
    if features.rotates {
        let (_, sign) = largest_component(rotation);
        moment.rates.iter().for_each(|rate| push(rate * sign / ranges.rate_unit));
    }
    words.extend(halves[..count].chunks(2).map(|pair| pair[0] | pair.get(1).copied().unwrap_or(0) << 16));
}

/// Appends the coefficients of degrees 1 to `degree`; those that the field lacks are 0.
fn pack_sh(coefficients: &[[f32; 3]], degree: u8, words: &mut Vec<u32>) {
    let largest = coefficients.iter().flatten().fold(0f32, |largest, c| largest.max(c.abs()));
    words.push(largest.to_bits());
    for k in 0..sh_words(degree) - 1 {
        let [r, g, b] = coefficients.get(k).copied().unwrap_or_default();
        let part =
            |c: f32, steps: f32| if largest > 0.0 { (c / largest * steps).round() as i32 as u32 } else { 0 };
        words.push(part(r, 1023.0) & 0x7ff | (part(g, 1023.0) & 0x7ff) << 11 | part(b, 511.0) << 22);
    }
}

#[cfg(test)]
mod tests;
