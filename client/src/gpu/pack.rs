//! Packs the Gaussians of a clip into the records that the stage `evaluate` reads.
//!
//! The precision of each quantity keeps its error on screen below a tenth of an 8-bit step, for windows and
//! motion below a fifth, see [`moment`]; the tests of this module check the bounds. Scales, motion and
//! brightness are clamped to the range of the record.

pub(in crate::gpu) mod moment;

use codec::{Field, LayerEnd, PixelFilter};
use glam::DVec3;
use half::f16;
use shaders::layout::Gaussian;
use shaders::{Features, LOG_SCALE_MAX, LOG_SCALE_STEP, Motion, RATE_UNIT, sh_words};

use super::layer_run::LayerRun;
use moment::{MOTION_MAX, Moment};

/// Number of widths of a window in which a Gaussian may cross the bounds of its clip. One that crosses them faster is
/// alive for no longer than this, with an alpha of hardly more than 1/255.
const CROSSING_WIDTHS: f32 = 0.125;

/// Number of centres sampled to find the origin of a clip.
const ORIGIN_ROWS: usize = 1000;

/// What the records of a clip, or of all segments of a take, depend on besides their Gaussians. It does not change when
/// further layers arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RecordFormat {
    /// At least the features of the Gaussians. Features that the Gaussians lack are 0.
    pub(crate) features: Features,
    /// Origin of the centres, in the world of the field.
    pub(crate) origin: DVec3,
    /// Factors of the motion coefficients of power 1, 2, 3.
    pub(crate) motion_units: [f32; 3],
}

/// The records of consecutive layers of a clip, or of a segment, static rows first.
pub(crate) struct Packed {
    /// Rows of the layers before, which are not in it.
    pub(crate) before: LayerEnd,
    /// Number of static rows.
    pub(crate) static_count: usize,
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
        (Some(row), Some(temporal)) => Moment::new(dynamic_field, temporal, row).position,
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

/// The features that shaders need for `count` rows of these fields, which need not be there yet.
pub(crate) fn features([static_field, dynamic_field]: [&Field; 2], count: LayerEnd) -> Features {
    let temporal = dynamic_field.temporal.as_ref().filter(|_| count.dynamic_count > 0);
    let motion = temporal
        .map(|temporal| Motion { order: temporal.motion_order, rotates: temporal.rotation_rates.is_some() });
    let sh_degree = [(static_field, count.static_count), (dynamic_field, count.dynamic_count)]
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(field, _)| field.sh_degree);
    let field = if count.dynamic_count == 0 { static_field } else { dynamic_field };
    let mip = field.filter == PixelFilter::Mip;
    Features { sh_degree: sh_degree.max().unwrap_or(0), motion, mip, segmented: false }
}

/// Factors of the motion coefficients of power 1, 2, 3 of a clip or a take whose centres stay in the box `bounds`, `[min,
/// max]`, while they are alive.
///
/// A cubic that stays within a length D over h widths on either side of an instant has coefficients of at most 2 D / h,
/// 2 D / h^2 and 2 D / h^3. They are near the top of the range of f16 for an h of [`CROSSING_WIDTHS`]; larger
/// coefficients are clamped, and coefficients of a millionth of D are still precise.
pub(crate) fn motion_units([low, high]: [[f32; 3]; 2]) -> [f32; 3] {
    let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f32::max);
    [1, 2, 3].map(|power| {
        let largest = 2.0 * extent / CROSSING_WIDTHS.powi(power);
        unit(largest.min(MOTION_MAX as f32))
    })
}

/// Packs layers: their static rows, whose temporal columns are ignored, followed by the dynamic ones.
pub(crate) fn pack(run: &LayerRun<'_>, format: &RecordFormat) -> Packed {
    let features = format.features;
    let motion = features.motion;
    let [static_count, dynamic_count] = run.rows.clone().map(|rows| rows.len());
    let mut packed = Packed {
        before: run.before,
        static_count,
        gaussians: Vec::with_capacity(run.len()),
        motion: Vec::with_capacity(motion.map_or(0, |motion| motion.words() * dynamic_count)),
        sh: Vec::with_capacity(sh_words(features.sh_degree) * run.len()),
    };
    let temporal = run.fields[1].temporal.as_ref();
    for (field, rows, temporal) in
        [(run.fields[0], &run.rows[0], None), (run.fields[1], &run.rows[1], temporal)]
    {
        for row in rows.clone() {
            let moment = temporal.map(|temporal| Moment::new(field, temporal, row));
            let (center, rotation) = match &moment {
                Some(moment) => (moment.position, moment.rotation),
                None => (field.centers[row].map(f64::from), field.rotations[row].map(f64::from)),
            };
            let rotation = normalized(rotation);
            let center = DVec3::from_array(center) - format.origin;
            packed.gaussians.push(pack_gaussian(field, row, center, rotation));
            if let Some((moment, motion)) = moment.zip(motion) {
                pack_motion(&moment, motion, rotation, format.motion_units, &mut packed.motion);
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

/// A power of two that scales `largest` near the top of the range of f16. A power of two is exact, and
/// small numbers stay normal.
fn unit(largest: f32) -> f32 {
    if largest == 0.0 { 1.0 } else { 2f32.powi((largest.log2().ceil() as i32 - 15).max(-100)) }
}

fn pack_gaussian(field: &Field, row: usize, center: DVec3, rotation: [f32; 4]) -> Gaussian {
    let scale = |axis: usize| {
        let log_scale = field.log_scales[row][axis].clamp(-LOG_SCALE_MAX, LOG_SCALE_MAX);
        ((log_scale + LOG_SCALE_MAX) / LOG_SCALE_STEP).round() as u32
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

fn pack_motion(moment: &Moment, features: Motion, rotation: [f32; 4], units: [f32; 3], words: &mut Vec<u32>) {
    words.push(u32::from(moment.instant) | u32::from(moment.z as u16) << 16);
    let mut halves = [0u32; 14];
    halves[0] = u32::from(moment.widths.to_bits());
    let mut count = 1;
    let mut push = |value: f32| {
        halves[count] = half_bits(value);
        count += 1;
    };
    for (w, unit) in moment.motion.iter().zip(units).take(features.order.into()) {
        w.iter().for_each(|x| push(x / unit));
    }
    if features.rotates {
        let (_, sign) = largest_component(rotation);
        moment.rates.iter().for_each(|rate| push(rate * sign / RATE_UNIT));
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
