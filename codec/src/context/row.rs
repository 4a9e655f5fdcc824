//! One Gaussian after the other: [`RowCoder`] codes the numbers of a row and returns the row that
//! a decoder gets. Both directions run this code.

use super::{
    Chunk,
    math::{exp, half_octaves, ln, round},
    model::{BitTree, Coding, Quantity},
    neighbors::{History, Neighbors},
    range::Symbols,
    rotation::{self, Shape},
    trajectory::{self, Span},
    watch::Part,
};
use crate::{SH_C0, fixed::Columns, rows::Rows, sh_coefficients};

/// Steps of the attributes, in units of what their visibility allows; found by minimising the
/// size at equal fidelity on captured fields. Format.
const OPACITY: f64 = 1.2;
const ROTATION: f64 = 1.9;
const COLOR: f64 = 1.45;
const CHROMA: f64 = 1.6;
const SH: f64 = 1.8;

/// Coarsest steps: of the logarithms of opacity and scale, of a colour. Format.
const OPACITY_STEP_MAX: f64 = 0.4;
const SCALE_STEP_MAX: f64 = 0.5;
const COLOR_STEP_MAX: f64 = 0.5;

/// Coarsest step of a position, and largest number of a Gaussian, in source units: larger ones
/// are cut to it. Format.
const POSITION_STEP_MAX: f64 = 1e10;
const NUMBER_MAX: f64 = 1e30;

/// Largest logarithm of a width on screen. Format.
pub(super) const LOG_EXTENT_MAX: f64 = 44.0;

/// How far predictions follow the neighbours, away from the mean. Format.
const SCALE_PULL: f64 = 0.3;
const COLOR_PULL: f64 = 0.4;

/// Squared steps of error in a spherical-harmonic coefficient that saving a bit is worth. The
/// slope at high rates is ln 2 / 6 = 0.12; here most coefficients take a bit or two.
const SH_LAMBDA: f64 = 0.15;

/// Bits of the classes of visibility and of contrast. Format.
pub(super) const CLASS_BITS: u32 = 5;
pub(super) const CONTRAST_BITS: u32 = 4;

/// What the encoder wants coded.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target<'a> {
    /// Half octaves that the colour's step is above the finest of the chunk.
    pub(super) class: u32,
    /// Half octaves that the geometry's step is above the colour's.
    pub(super) contrast: u32,
    /// Multiples of their steps: minus the logarithm of the opacity, the number of the window's
    /// width, and its centre relative to the middle of the clip.
    pub(super) window: [f64; 3],
    /// Logarithms of the standard deviations, widest first, and the axes they belong to, as
    /// vectors of the world.
    pub(super) log_scales: [f64; 3],
    pub(super) axes: [[f64; 3]; 3],
    /// Coefficients of the orthogonal polynomials of the trajectory.
    pub(super) trajectory: [[f64; 3]; 4],
    /// The quaternion that multiplied from the left by the rotation is its rate; its vector part
    /// in the axes of the world.
    pub(super) spin: [f64; 4],
    pub(super) sh: &'a [[f32; 3]],
}

/// A Gaussian as it is decoded.
#[derive(Clone, Debug, Default)]
pub(super) struct Row {
    pub(super) center: [f32; 3],
    pub(super) rotation: [f32; 4],
    pub(super) log_scales: [f32; 3],
    pub(super) opacity: f32,
    pub(super) sh: Vec<[f32; 3]>,
    pub(super) tau: f32,
    pub(super) s: f32,
    pub(super) motion: [[f32; 3]; 3],
    pub(super) rotation_rate: [f32; 4],
}

/// The models of a chunk, and what it remembers.
pub(super) struct RowCoder<'a> {
    chunk: &'a Chunk,
    columns: Columns,
    classes: Vec<BitTree>,
    contrasts: Vec<BitTree>,
    opacity: Quantity,
    scales: [Quantity; 3],
    directions: Vec<BitTree>,
    width: Quantity,
    center: Quantity,
    motion: Vec<Quantity>,
    spin: Vec<Quantity>,
    colors: [Quantity; 3],
    sh: Vec<Quantity>,
    neighbors: Neighbors,
    last_class: u32,
    last_contrast: u32,
    row: Row,
}

impl<'a> RowCoder<'a> {
    pub(super) fn new(chunk: &'a Chunk, columns: Columns) -> RowCoder<'a> {
        let quantity = Quantity::new();
        let temporal = columns.temporal.unwrap_or_default();
        let sh = sh_coefficients(columns.sh_degree);
        RowCoder {
            chunk,
            columns,
            classes: vec![BitTree::new(CLASS_BITS); 1 << CLASS_BITS],
            contrasts: vec![BitTree::new(CONTRAST_BITS); 1 << (CLASS_BITS - 2 + CONTRAST_BITS - 2)],
            opacity: quantity.clone(),
            scales: std::array::from_fn(|_| quantity.clone()),
            directions: (0..2 * (DIRECTION_LEVELS + 1)).map(|i| BitTree::new(2 * (i / 2))).collect(),
            width: quantity.clone(),
            center: quantity.clone(),
            motion: vec![quantity.clone(); 3 * usize::from(temporal.motion_order)],
            spin: vec![quantity.clone(); if temporal.rotation_rates { 4 } else { 0 }],
            colors: std::array::from_fn(|_| quantity.clone()),
            sh: vec![quantity; 3 * (sh - 1)],
            neighbors: Neighbors::default(),
            last_class: 0,
            last_contrast: 0,
            row: Row { sh: vec![[0.0; 3]; sh], ..Row::default() },
        }
    }

    /// Codes the Gaussian in `cell` and returns it as decoded; `None` if a number is out of range,
    /// which happens in damaged streams only. `wanted` is there if symbols are encoded.
    pub(super) fn code<S: Symbols>(
        &mut self,
        symbols: &mut S,
        cell: [u32; 3],
        wanted: Option<&Target>,
    ) -> Option<&Row> {
        self.neighbors.find(cell);
        let mut past = History { cell, ..History::default() };
        let (color_step, step) = self.code_classes(symbols, wanted);
        self.code_window(symbols, step, wanted);
        let (sigma, shape) = self.code_shape(symbols, step, wanted, &mut past)?;
        self.code_trajectory(symbols, sigma, shape, step, cell, wanted);
        self.code_colors(symbols, color_step, wanted, &mut past);
        self.neighbors.push(past);
        self.row.is_valid().then_some(&self.row)
    }

    /// The steps of colour and geometry.
    fn code_classes<S: Symbols>(&mut self, symbols: &mut S, wanted: Option<&Target>) -> (f64, f64) {
        symbols.begin(Part::Classes, 0);
        let class = self.classes[self.last_class as usize].code(symbols, wanted.map_or(0, |w| w.class));
        symbols.number(class as i32, class as i32);
        symbols.begin(Part::Classes, 1);
        let context = 4 * (class / 4) + self.last_contrast / 4;
        let contrast = self.contrasts[context as usize].code(symbols, wanted.map_or(0, |w| w.contrast));
        symbols.number(contrast as i32, contrast as i32);
        (self.last_class, self.last_contrast) = (class, contrast);
        let color_step = f64::from(self.chunk.step) * half_octaves(class);
        (color_step, color_step * half_octaves(contrast))
    }

    /// Opacity and window.
    fn code_window<S: Symbols>(&mut self, symbols: &mut S, step: f64, wanted: Option<&Target>) {
        let [opacity, width, center] = wanted.map_or([0.0; 3], |w| w.window);
        // Zero stands for opaque and, of widths, for always on: nothing else is as frequent.
        let unit = opacity_step(step);
        symbols.begin(Part::Opacity, 0);
        let code = self.opacity.code(symbols, opacity, Coding::near(unit, 0.0));
        self.row.opacity = decoded_opacity(f64::from(code) * unit);
        if self.columns.temporal.is_none() {
            return;
        }
        let unit = trajectory::width_step(step);
        symbols.begin(Part::Window, 0);
        let code = self.width.code(symbols, width, Coding::near(unit, 0.0));
        self.row.s = trajectory::width(f64::from(code) * unit) as f32;
        self.row.tau = 0.5;
        if self.row.s.is_finite() {
            let unit = trajectory::center_step(f64::from(self.row.s), step);
            symbols.begin(Part::Window, 1);
            let code = self.center.code(symbols, center, Coding::near(unit, self.center.mean()));
            self.row.tau = decoded_tau(f64::from(code) * unit);
        }
    }

    /// Scales and rotation; the standard deviations as they look at the resolution of the chunk,
    /// widest first.
    fn code_shape<S: Symbols>(
        &mut self,
        symbols: &mut S,
        step: f64,
        wanted: Option<&Target>,
        past: &mut History,
    ) -> Option<([f64; 3], Shape)> {
        let footprint = f64::from(self.chunk.footprint);
        let base = ln(footprint);
        let unit = step.min(SCALE_STEP_MAX);
        let mut extents = [0.0; 3];
        let mut log_scales = [0.0; 3];
        let mut last = base;
        for (r, quantity) in self.scales.iter_mut().enumerate() {
            let number = wanted.map_or(0.0, |w| log_extent(w.log_scales[r], footprint) - last);
            let mean = quantity.mean();
            let pull = SCALE_PULL * (self.neighbors.mean(mean, |past| past.scales[r]) - mean);
            symbols.begin(Part::Scales, r);
            let code = quantity.code(symbols, number, Coding::near(unit, mean + pull));
            let extent = (last + f64::from(code) * unit).max(base);
            if extent > LOG_EXTENT_MAX {
                return None;
            }
            past.scales[r] = extent - last;
            last = extent;
            extents[r] = exp(extent);
            let thin = extents[r] * extents[r] - footprint * footprint;
            log_scales[r] = 0.5 * ln(thin.max(footprint * footprint / 1024.0));
        }

        let shape = Shape::new(extents, ROTATION * step);
        symbols.begin(Part::Rotation, 0);
        symbols.choice(f64::from(shape.direction_codes).powi(2) * f64::from(shape.roll_codes));
        let pole = self.neighbors.nearest().map_or(rotation::FIRST_POLE, |past| past.direction);
        let wanted_axes = wanted.map(|w| shape.axes.map(|axis| w.axes[axis]));
        let place = self.code_direction(symbols, &shape, wanted_axes.map(|axes| axes[2]), pole);
        let direction = rotation::direction(place, pole, shape.direction_codes);
        let roll = wanted_axes.map_or(0, |axes| roll_code(direction, axes[0], shape.roll_codes));
        let roll = symbols.uniform(shape.roll_codes, roll);
        past.direction = direction;
        self.row.rotation = rotation::quaternion(direction, roll, shape.roll_codes).map(|x| x as f32);
        self.row.log_scales = shape.axes.map(|axis| log_scales[axis] as f32);
        Some((extents, shape))
    }

    /// The codes of a direction: which of the parts of the hemisphere, then where in it.
    fn code_direction<S: Symbols>(
        &mut self,
        symbols: &mut S,
        shape: &Shape,
        wanted: Option<[f64; 3]>,
        pole: [f64; 3],
    ) -> [u32; 2] {
        let codes = shape.direction_codes;
        let wanted = wanted.map_or([0; 2], |direction| rotation::direction_codes(direction, pole, codes));
        let level = codes.ilog2().min(DIRECTION_LEVELS);
        let part = wanted.map(|x| (x << level) / codes);
        // The bits of both coordinates in turn, so that the tree halves the square both ways.
        let morton =
            (0..level).rev().fold(0, |m, bit| m << 2 | (part[0] >> bit & 1) << 1 | part[1] >> bit & 1);
        let tree = &mut self.directions[(2 * level + u32::from(shape.is_needle())) as usize];
        let morton = tree.code(symbols, morton);
        let axis = |shift: u32| (0..level).fold(0, |x, bit| x | (morton >> (2 * bit + shift) & 1) << bit);
        let mut place = [axis(1), axis(0)];
        for (x, wanted) in place.iter_mut().zip(wanted) {
            let start = (*x * codes).div_ceil(1 << level);
            let end = ((*x + 1) * codes).div_ceil(1 << level);
            *x = start + symbols.uniform(end - start, wanted.wrapping_sub(start));
        }
        place
    }

    /// Position, motion and spin.
    fn code_trajectory<S: Symbols>(
        &mut self,
        symbols: &mut S,
        extents: [f64; 3],
        shape: Shape,
        step: f64,
        cell: [u32; 3],
        wanted: Option<&Target>,
    ) {
        let unit = (step * size_of(extents)).min(POSITION_STEP_MAX);
        let cell_size = f64::from(self.chunk.cell_size);
        let parts = round(cell_size / unit).clamp(1.0, 65536.0);
        symbols.begin(Part::Position, 0);
        symbols.choice(parts.powi(3));
        let mut c = [[0.0; 3]; 4];
        for axis in 0..3 {
            let origin = f64::from(self.chunk.origin[axis]);
            let corner = origin + f64::from(cell[axis]) * cell_size;
            let part = wanted.map_or(0, |w| {
                let place = (w.trajectory[0][axis] - corner) / cell_size * parts;
                (place.max(0.0) as u32).min(parts as u32 - 1)
            });
            let part = symbols.uniform(parts as u32, part);
            c[0][axis] = corner + (f64::from(part) + 0.5) / parts * cell_size;
        }
        let Some(temporal) = self.columns.temporal else {
            self.row.center = c[0].map(narrowed);
            return;
        };
        let (tau, s) = (f64::from(self.row.tau), f64::from(self.row.s));
        let span = Span::new(f64::from(self.row.opacity), tau, s);
        let mut energy = Energy::default();
        for (i, quantity) in self.motion.iter_mut().enumerate() {
            let (power, axis) = (1 + i / 3, i % 3);
            let unit = unit / span.size[power];
            let number = wanted.map_or(0.0, |w| w.trajectory[power][axis]);
            symbols.begin(Part::Motion, i);
            let code = energy.code(symbols, quantity, number, unit, 0.0);
            c[power][axis] = f64::from(code) * unit;
        }
        for axis in 0..3 {
            let [p0, powers @ ..] = span.powers([0, 1, 2, 3].map(|power| c[power][axis]), tau);
            self.row.center[axis] = narrowed(p0);
            for (v, power) in self.row.motion.iter_mut().zip(powers) {
                v[axis] = narrowed(power);
            }
        }
        if temporal.rotation_rates {
            self.code_spin(symbols, &shape, span.reach, wanted);
        }
    }

    /// The rate of the quaternion, in the Gaussian's own axes.
    fn code_spin<S: Symbols>(&mut self, symbols: &mut S, shape: &Shape, reach: f64, wanted: Option<&Target>) {
        let q = self.row.rotation.map(f64::from);
        // Root mean square of the time from tau, as over an even span on both sides.
        let time = 0.577 * reach.max(1e-3);
        let (direction, roll) = (0.5 * shape.direction_step / time, 0.5 * shape.roll_step / time);
        let own = wanted.map_or([0.0; 4], |w| {
            let [scalar, rest @ ..] = w.spin;
            let inverse = [q[0], -q[1], -q[2], -q[3]];
            let [x, y, z] = rotation::turn(inverse, rest);
            [scalar, x, y, z]
        });
        let units = [direction.min(roll), direction, direction, roll];
        let mut rate = [0.0; 4];
        for i in 0..4 {
            symbols.begin(Part::Spin, i);
            let code = self.spin[i].code(symbols, own[i], Coding::near(units[i], 0.0));
            rate[i] = f64::from(code) * units[i];
        }
        self.row.rotation_rate = product(q, rate).map(narrowed);
    }

    /// Colour and spherical harmonics.
    fn code_colors<S: Symbols>(
        &mut self,
        symbols: &mut S,
        step: f64,
        wanted: Option<&Target>,
        past: &mut History,
    ) {
        let number = |k: usize| wanted.map_or([0.0; 3], |w| w.sh[k].map(f64::from));
        let color = luma_chroma(number(0).map(|x| x * SH_C0));
        for (i, quantity) in self.colors.iter_mut().enumerate() {
            let unit = (step * if i == 0 { COLOR } else { COLOR * CHROMA }).min(COLOR_STEP_MAX);
            let mean = quantity.mean();
            let pull = COLOR_PULL * (self.neighbors.mean(mean, |past| past.color[i]) - mean);
            symbols.begin(Part::Color, i);
            let code = quantity.code(symbols, color[i], Coding::near(unit, mean + pull));
            past.color[i] = f64::from(code) * unit;
        }
        self.row.sh[0] = rgb(past.color).map(|x| narrowed(x / SH_C0));

        let unit = SH * step / SH_C0;
        let mut energy = Energy::default();
        for (k, quantities) in (1..).zip(self.sh.chunks_exact_mut(3)) {
            let opponents = opponents(number(k));
            let mut coded = [0.0; 3];
            for (i, quantity) in quantities.iter_mut().enumerate() {
                symbols.begin(Part::Harmonics, 3 * k + i);
                coded[i] = f64::from(energy.code(symbols, quantity, opponents[i], unit, SH_LAMBDA)) * unit;
            }
            self.row.sh[k] = channels(coded).map(narrowed);
        }
    }
}

impl Row {
    /// Writes the row to row `i` of `out`, which has the columns of the chunk.
    pub(super) fn write_to(&self, out: &mut Rows, i: usize) {
        out.centers[i] = self.center;
        out.rotations[i] = self.rotation;
        out.log_scales[i] = self.log_scales;
        out.opacities[i] = self.opacity;
        out.sh[i * self.sh.len()..][..self.sh.len()].copy_from_slice(&self.sh);
        if let Some(temporal) = &mut out.temporal {
            temporal.tau[i] = self.tau;
            temporal.s[i] = self.s;
            let order = usize::from(temporal.motion_order);
            temporal.motion[i * order..][..order].copy_from_slice(&self.motion[..order]);
            if let Some(rates) = &mut temporal.rotation_rates {
                rates[i] = self.rotation_rate;
            }
        }
    }

    /// Whether every number is what a field allows.
    fn is_valid(&self) -> bool {
        let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
        finite(&self.center)
            && finite(&self.rotation)
            && finite(&self.log_scales)
            && (0.0..=1.0).contains(&self.opacity)
            && finite(self.sh.as_flattened())
            && finite(&[self.tau])
            && finite(self.motion.as_flattened())
            && finite(&self.rotation_rate)
    }
}

/// A number of a Gaussian.
fn narrowed(x: f64) -> f32 {
    x.clamp(-NUMBER_MAX, NUMBER_MAX) as f32
}

/// Levels of halving of both coordinates of a direction that adapt. Format.
const DIRECTION_LEVELS: u32 = 4;

/// Step of the logarithm of the opacity.
pub(super) fn opacity_step(step: f64) -> f64 {
    (OPACITY * step).min(OPACITY_STEP_MAX)
}

/// The opacity of a coded number.
pub(super) fn decoded_opacity(number: f64) -> f32 {
    (exp(-number) as f32).min(1.0)
}

/// The window centre of a coded number.
pub(super) fn decoded_tau(number: f64) -> f32 {
    (0.5 + number) as f32
}

/// The size of a Gaussian that its position is coded in proportion to.
fn size_of(extents: [f64; 3]) -> f64 {
    0.5 * (extents[0] * extents[1]).sqrt() + 0.5 * extents[2]
}

/// Step of the position, but for the rounding of the scales.
#[cfg(feature = "encode")]
pub(super) fn position_step(chunk: &Chunk, wanted: &Target) -> f64 {
    let step = f64::from(chunk.step) * half_octaves(wanted.class) * half_octaves(wanted.contrast);
    step * size_of(wanted.log_scales.map(|x| exp(log_extent(x, f64::from(chunk.footprint)))))
}

/// The rate of a quaternion as in [`Target::spin`].
#[cfg(feature = "encode")]
pub(super) fn spin(q: [f64; 4], rate: [f64; 4]) -> [f64; 4] {
    let [scalar, rest @ ..] = product([q[0], -q[1], -q[2], -q[3]], rate);
    let [x, y, z] = rotation::turn(q, rest);
    [scalar, x, y, z]
}

/// Logarithm of the width on screen of a standard deviation with logarithm `log_scale`.
fn log_extent(log_scale: f64, footprint: f64) -> f64 {
    let sigma = exp(log_scale);
    0.5 * ln(sigma * sigma + footprint * footprint)
}

/// How much larger than expected the numbers of a Gaussian are that are already coded: its next
/// ones will be too.
#[derive(Default)]
struct Energy {
    coded: f64,
    expected: f64,
}

impl Energy {
    fn code<S: Symbols>(
        &mut self,
        symbols: &mut S,
        quantity: &mut Quantity,
        number: f64,
        step: f64,
        lambda: f64,
    ) -> i32 {
        let expected = quantity.expected(step);
        let weight = expected.max(0.05);
        let spread = (self.coded + weight) / (self.expected + weight);
        let code = quantity.code(symbols, number, Coding { step, prediction: 0.0, spread, lambda });
        self.coded += f64::from(code.unsigned_abs());
        self.expected += expected;
        code
    }
}

/// Luma and two differences of a colour, lifted so that one less step keeps all three.
fn luma_chroma([r, g, b]: [f64; 3]) -> [f64; 3] {
    [(r + 2.0 * g + b) * 0.25, r - b, g - (r + b) * 0.5]
}

/// The way back from [`luma_chroma`].
fn rgb([y, red_blue, green]: [f64; 3]) -> [f64; 3] {
    let g = y + green * 0.5;
    let sum = 2.0 * (g - green);
    [(sum + red_blue) * 0.5, g, (sum - red_blue) * 0.5]
}

const SQRT_3: f64 = 1.732_050_807_568_877_2;
const SQRT_6: f64 = 2.449_489_742_783_178;

/// An orthonormal transform of the channels: sum and two differences.
fn opponents([r, g, b]: [f64; 3]) -> [f64; 3] {
    [(r + g + b) / SQRT_3, (r - b) / std::f64::consts::SQRT_2, (r - 2.0 * g + b) / SQRT_6]
}

/// The way back from [`opponents`].
fn channels([sum, red_blue, green]: [f64; 3]) -> [f64; 3] {
    let (s, d, e) = (sum / SQRT_3, red_blue / std::f64::consts::SQRT_2, green / SQRT_6);
    [s + d + e, s - 2.0 * e, s - d + e]
}

/// Product of two quaternions.
fn product([aw, ax, ay, az]: [f64; 4], [bw, bx, by, bz]: [f64; 4]) -> [f64; 4] {
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

/// The roll that turns the first axis nearest to `axis`. Only the encoder asks, and what it gets
/// is coded, so that the last bits of the arc tangent do not matter to the decoder.
fn roll_code(direction: [f64; 3], axis: [f64; 3], codes: u32) -> u32 {
    let [x, y] =
        rotation::roll_axes(direction).map(|e: [f64; 3]| e[0] * axis[0] + e[1] * axis[1] + e[2] * axis[2]);
    let turn = (libm::atan2(y, x) / std::f64::consts::PI).rem_euclid(1.0);
    ((turn * f64::from(codes)) as u32).min(codes - 1)
}
