//! [`RowCoder`]: codes one Gaussian after the other, for encoder and decoder alike. It returns the
//! decoded row.

use super::{
    chunk::Chunk,
    color::{channels, luma_chroma, opponents, rgb},
    decoded::{Row, narrowed},
    neighbors::{History, Neighbors},
    quantity::{Coding, Quantity},
    rotation::{self, RotationQuantiser},
    trajectory::{self, Span},
};
use crate::{
    SH_C0,
    columns::Columns,
    rans::{
        Attribute, NibbleTree, Prior, Symbols, TokenInteger,
        math::{self, Unit, half_octaves},
    },
    sh_coefficients,
};

/// Steps of the attributes relative to the step that the quantiser indices give. Found by minimising
/// size at equal fidelity on captured fields. Format.
const OPACITY: f64 = 1.2;
const ROTATION: f64 = 1.9;
const COLOR: f64 = 1.45;
const CHROMA: f64 = 1.6;
const SH: f64 = 1.8;

/// Coarsest steps of the logarithms of opacity and scale, and of a colour. Format.
const OPACITY_STEP_MAX: f64 = 0.4;
const SCALE_STEP_MAX: f64 = 0.5;
const COLOR_STEP_MAX: f64 = 0.5;

/// Coarsest step of a position in source units. Format.
const POSITION_STEP_MAX: f64 = 1e10;

const SH_C0_UNIT: Unit = Unit::new(SH_C0);

/// Largest logarithm of a blurred standard deviation. Format.
pub(super) const LOG_EXTENT_MAX: f64 = 44.0;

/// Weight of the neighbours' mean, against the mean of all, in predictions. Format.
const SCALE_NEIGHBOR_WEIGHT: f64 = 0.3;
const COLOR_NEIGHBOR_WEIGHT: f64 = 0.4;

/// Rate-distortion trade-off of a spherical-harmonic coefficient: squared error, in steps, that is
/// worth a bit. The slope at high rates is ln 2 / 6 = 0.12; most coefficients take a bit or two.
const SH_LAMBDA: f64 = 0.15;

/// Rate-distortion trade-off of scales, motion and colours, which take more bits. At the same PSNR, packages of
/// spinach get 1 to 2 % smaller; with 0.1, packages of the guitar get larger.
const LAMBDA: f64 = 0.05;

/// Bits of the visibility index and of the geometry index. Format.
pub(super) const VISIBILITY_BITS: u32 = 5;
pub(super) const GEOMETRY_BITS: u32 = 4;

/// Number of contexts of the geometry index.
pub(super) const GEOMETRY_CONTEXTS: usize = 1 << (VISIBILITY_BITS - 2 + GEOMETRY_BITS - 2);

/// Context of the geometry index: a quarter of the visibility index and of the last geometry index. Format.
pub(super) fn geometry_context(visibility: u32, last_geometry: u32) -> usize {
    (4 * (visibility / 4) + last_geometry / 4) as usize
}

/// A Gaussian for the encoder, in the coordinates that are coded.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target<'a> {
    /// Half octaves from the finest colour step of the chunk to this colour step.
    pub(super) visibility_index: u32,
    /// Half octaves from the colour step to the geometry step.
    pub(super) geometry_index: u32,
    /// Multiples of their steps: minus the logarithm of the opacity, the number of the window width,
    /// and the window centre relative to the centre of the clip.
    pub(super) window: [f64; 3],
    /// Logarithms of the standard deviations, widest first, and their axes as world vectors.
    pub(super) log_scales: [f64; 3],
    pub(super) axes: [[f64; 3]; 3],
    /// Coefficients of the orthogonal polynomials of the trajectory.
    pub(super) trajectory: [[f64; 3]; 4],
    /// The quaternion `inverse(rotation) * rate`, with its vector part rotated to world axes.
    pub(super) angular_rate: [f64; 4],
    pub(super) sh: &'a [[f32; 3]],
}

/// The models of a chunk.
pub(super) struct RowCoder<'a> {
    chunk: &'a Chunk,
    columns: Columns,
    /// Logarithm of the footprint.
    base_extent: f64,
    /// Models of the quantities.
    models: Vec<TokenInteger>,
    /// By the last visibility index.
    visibility_indices: Vec<NibbleTree>,
    /// By [`geometry_context`].
    geometry_indices: Vec<NibbleTree>,
    opacity: Quantity,
    scales: [Quantity; 3],
    directions: Vec<NibbleTree>,
    width: Quantity,
    center: Quantity,
    motion: Vec<Quantity>,
    angular_rate: Vec<Quantity>,
    colors: [Quantity; 3],
    harmonics: Vec<Quantity>,
    neighbors: Neighbors,
    last_visibility: u32,
    last_geometry: u32,
    row: Row,
}

impl<'a> RowCoder<'a> {
    pub(super) fn new(chunk: &'a Chunk, columns: Columns) -> RowCoder<'a> {
        let temporal = columns.temporal.unwrap_or_default();
        let sh = sh_coefficients(columns.sh_degree);
        let mut models = Vec::new();
        let mut quantities = |attribute: Attribute, count: usize| -> Vec<Quantity> {
            let first = models.len();
            let group = |component| TokenInteger::group(attribute, component);
            let groups = (0..count).map(|component| group(component) + 1).max().unwrap_or(0);
            models.extend((0..groups).map(|_| TokenInteger::new(attribute)));
            (0..count).map(|component| Quantity::new(first + group(component))).collect()
        };
        let [opacity, width, center] = [Attribute::Opacity, Attribute::WindowWidth, Attribute::WindowCenter]
            .map(|attribute| quantities(attribute, 1).remove(0));
        let mut three = |attribute| {
            let quantities = quantities(attribute, 3);
            std::array::from_fn(|i| quantities[i].clone())
        };
        let (scales, colors) = (three(Attribute::Scales), three(Attribute::Color));
        let motion = quantities(Attribute::Motion, 3 * usize::from(temporal.motion_order));
        let angular_rate = quantities(Attribute::AngularRate, if temporal.rotation_rates { 4 } else { 0 });
        let harmonics = quantities(Attribute::Harmonics, 3 * (sh - 1));
        RowCoder {
            chunk,
            columns,
            base_extent: math::ln(f64::from(chunk.footprint)),
            models,
            visibility_indices: (0..1 << VISIBILITY_BITS)
                .map(|last| NibbleTree::new(VISIBILITY_BITS, Prior::Near(last)))
                .collect(),
            geometry_indices: vec![NibbleTree::new(GEOMETRY_BITS, Prior::Nothing); GEOMETRY_CONTEXTS],
            opacity,
            scales,
            directions: (0..2 * (DIRECTION_LEVELS + 1))
                .map(|i| NibbleTree::new(2 * (i / 2), Prior::NearCenterOfSquare))
                .collect(),
            width,
            center,
            motion,
            angular_rate,
            colors,
            harmonics,
            neighbors: Neighbors::default(),
            last_visibility: 0,
            last_geometry: 0,
            row: Row { sh: vec![[0.0; 3]; sh], ..Row::default() },
        }
    }

    /// Codes the Gaussian in `cell` and returns it as decoded; `None` if a number is out of range,
    /// in damaged streams only. The encoder passes `target`.
    pub(super) fn code(
        &mut self,
        symbols: &mut impl Symbols,
        cell: [u32; 3],
        target: Option<&Target>,
    ) -> Option<&Row> {
        if self.chunk.has_neighbors {
            self.neighbors.find(cell);
        }
        let mut history = History::default();
        let (color_step, step) = self.code_indices(symbols, target);
        self.code_window(symbols, step, target);
        // Needed for the motion; a processor computes it while it waits for the symbols of the shape.
        let temporal = self.columns.temporal.map(|temporal| (temporal, self.row.span()));
        let (extents, quantiser) = self.code_shape(symbols, step, target, &mut history)?;
        let unit = Unit::new((step * size_of(extents)).min(POSITION_STEP_MAX));
        let position = self.code_position(symbols, unit, cell, target);
        match temporal {
            None => self.row.center = position.map(narrowed),
            Some((temporal, span)) => {
                self.code_motion(symbols, &span, position, unit, target);
                if temporal.rotation_rates {
                    self.code_angular_rate(symbols, &quantiser, span.support_radius, target);
                }
            }
        }
        self.code_colors(symbols, color_step, target, &mut history);
        if self.chunk.has_neighbors {
            self.neighbors.push(cell, history);
        }
        self.row.is_valid().then_some(&self.row)
    }

    /// Codes the quantiser indices, and returns the steps of colour and geometry.
    fn code_indices(&mut self, symbols: &mut impl Symbols, target: Option<&Target>) -> (f64, f64) {
        symbols.begin(Attribute::QuantiserIndices, 0);
        let tree = &mut self.visibility_indices[self.last_visibility as usize];
        let visibility = tree.code(symbols, target.map_or(0, |t| t.visibility_index));
        symbols.number(visibility as i32, visibility as i32);
        symbols.begin(Attribute::QuantiserIndices, 1);
        let tree = &mut self.geometry_indices[geometry_context(visibility, self.last_geometry)];
        let geometry = tree.code(symbols, target.map_or(0, |t| t.geometry_index));
        symbols.number(geometry as i32, geometry as i32);
        (self.last_visibility, self.last_geometry) = (visibility, geometry);
        let color_step = f64::from(self.chunk.step) * half_octaves(visibility);
        (color_step, color_step * half_octaves(geometry))
    }

    /// Codes opacity and window.
    fn code_window(&mut self, symbols: &mut impl Symbols, step: f64, target: Option<&Target>) {
        let [opacity, width, center] = target.map_or([0.0; 3], |t| t.window);
        // Code 0 means opaque and, for widths, always on: the most frequent values.
        let unit = Unit::new(opacity_step(step));
        symbols.begin(Attribute::Opacity, 0);
        let code = self.opacity.code(symbols, &mut self.models, opacity, Coding::near(unit, 0.0));
        self.row.opacity = decoded_opacity(f64::from(code) * unit.size);
        if self.columns.temporal.is_none() {
            return;
        }
        let unit = Unit::new(trajectory::width_step(step));
        symbols.begin(Attribute::WindowWidth, 0);
        let code = self.width.code(symbols, &mut self.models, width, Coding::near(unit, 0.0));
        self.row.s = trajectory::width(f64::from(code) * unit.size) as f32;
        self.row.tau = 0.5;
        if self.row.s.is_finite() {
            let unit = Unit::new(trajectory::center_step(f64::from(self.row.s), step));
            symbols.begin(Attribute::WindowCenter, 0);
            let code =
                self.center.code(symbols, &mut self.models, center, Coding::near(unit, self.center.mean()));
            self.row.tau = decoded_tau(f64::from(code) * unit.size);
        }
    }

    /// Codes scales and rotation, and returns the standard deviations blurred by the footprint, widest
    /// first.
    fn code_shape(
        &mut self,
        symbols: &mut impl Symbols,
        step: f64,
        target: Option<&Target>,
        history: &mut History,
    ) -> Option<([f64; 3], RotationQuantiser)> {
        let footprint = f64::from(self.chunk.footprint);
        let base = self.base_extent;
        let unit = Unit::new(step.min(SCALE_STEP_MAX));
        let mut extents = [0.0; 3];
        let mut log_scales = [0.0; 3];
        let mut last = base;
        for (r, quantity) in self.scales.iter_mut().enumerate() {
            let number = target.map_or(0.0, |t| log_extent(t.log_scales[r], footprint) - last);
            let mean = quantity.mean();
            let offset =
                SCALE_NEIGHBOR_WEIGHT * (self.neighbors.mean(mean, |history| history.scales[r]) - mean);
            symbols.begin(Attribute::Scales, r);
            let coding = Coding { lambda: LAMBDA, ..Coding::near(unit, mean + offset) };
            let code = quantity.code(symbols, &mut self.models, number, coding);
            let extent = (last + f64::from(code) * unit.size).max(base);
            if extent > LOG_EXTENT_MAX {
                return None;
            }
            history.scales[r] = extent - last;
            last = extent;
            extents[r] = math::exp(extent);
            let variance = extents[r] * extents[r] - footprint * footprint;
            log_scales[r] = 0.5 * math::ln(variance.max(footprint * footprint / 1024.0));
        }

        let quantiser = RotationQuantiser::new(extents, ROTATION * step);
        symbols.begin(Attribute::Rotation, 0);
        symbols.choice(f64::from(quantiser.direction_codes).powi(2) * f64::from(quantiser.roll_codes));
        let pole = self.neighbors.nearest().map_or(rotation::FIRST_POLE, |history| history.direction);
        let target_axes = target.map(|t| quantiser.axes.map(|axis| t.axes[axis]));
        let direction_codes = self.code_direction(symbols, &quantiser, target_axes.map(|axes| axes[2]), pole);
        let direction = rotation::direction(direction_codes, pole, quantiser.direction_codes);
        let roll = target_axes.map_or(0, |axes| roll_code(direction, axes[0], quantiser.roll_codes));
        let roll = symbols.uniform(quantiser.roll_codes, roll);
        history.direction = direction;
        self.row.rotation = rotation::quaternion(direction, roll, quantiser.roll_codes).map(|x| x as f32);
        self.row.log_scales = quantiser.axes.map(|axis| log_scales[axis] as f32);
        Some((extents, quantiser))
    }

    /// Codes a direction: a square of the octahedral map by a tree, then the position within it.
    fn code_direction(
        &mut self,
        symbols: &mut impl Symbols,
        quantiser: &RotationQuantiser,
        target: Option<[f64; 3]>,
        pole: [f64; 3],
    ) -> [u32; 2] {
        let codes = quantiser.direction_codes;
        let target = target.map_or([0; 2], |direction| rotation::direction_codes(direction, pole, codes));
        let level = codes.ilog2().min(DIRECTION_LEVELS);
        let part = target.map(|x| (x << level) / codes);
        // Interleaves the bits of both coordinates, so that the tree halves the map both ways.
        let morton =
            (0..level).rev().fold(0, |m, bit| m << 2 | (part[0] >> bit & 1) << 1 | part[1] >> bit & 1);
        let tree = &mut self.directions[(2 * level + u32::from(quantiser.is_needle())) as usize];
        let morton = tree.code(symbols, morton);
        let axis = |shift: u32| (0..level).fold(0, |x, bit| x | (morton >> (2 * bit + shift) & 1) << bit);
        let mut direction_codes = [axis(1), axis(0)];
        for (x, target) in direction_codes.iter_mut().zip(target) {
            let start = (*x * codes).div_ceil(1 << level);
            let end = ((*x + 1) * codes).div_ceil(1 << level);
            *x = start + symbols.uniform(end - start, target.wrapping_sub(start));
        }
        direction_codes
    }

    /// Codes the position within a cell: the centre at the middle of the span.
    fn code_position(
        &mut self,
        symbols: &mut impl Symbols,
        unit: Unit,
        cell: [u32; 3],
        target: Option<&Target>,
    ) -> [f64; 3] {
        let cell_size = f64::from(self.chunk.cell_size);
        let parts = Unit::new(math::round(math::in_units(cell_size, unit)).clamp(1.0, 65536.0));
        symbols.begin(Attribute::Position, 0);
        symbols.choice(parts.size.powi(3));
        let mut position = [0.0; 3];
        for axis in 0..3 {
            let origin = f64::from(self.chunk.origin[axis]);
            let corner = origin + f64::from(cell[axis]) * cell_size;
            let part = target.map_or(0, |t| {
                let position = (t.trajectory[0][axis] - corner) / cell_size * parts.size;
                (position.max(0.0) as u32).min(parts.size as u32 - 1)
            });
            let part = symbols.uniform(parts.size as u32, part);
            position[axis] = corner + math::in_units(f64::from(part) + 0.5, parts) * cell_size;
        }
        position
    }

    /// Codes the motion, given the position and its step.
    fn code_motion(
        &mut self,
        symbols: &mut impl Symbols,
        span: &Span,
        position: [f64; 3],
        unit: Unit,
        target: Option<&Target>,
    ) {
        let mut c = [position, [0.0; 3], [0.0; 3], [0.0; 3]];
        let mut energy = Energy::default();
        for (power, quantities) in (1..).zip(self.motion.chunks_exact_mut(3)) {
            let unit = unit.over(span.size[power]);
            for (axis, quantity) in quantities.iter_mut().enumerate() {
                let number = target.map_or(0.0, |t| t.trajectory[power][axis]);
                symbols.begin(Attribute::Motion, 3 * (power - 1) + axis);
                let code = energy.code(symbols, &mut self.models, quantity, number, unit, LAMBDA);
                c[power][axis] = f64::from(code) * unit.size;
            }
        }
        for axis in 0..3 {
            let [p0, powers @ ..] = span.powers(c.map(|numbers| numbers[axis]), f64::from(self.row.tau));
            self.row.center[axis] = narrowed(p0);
            for (v, power) in self.row.motion.iter_mut().zip(powers) {
                v[axis] = narrowed(power);
            }
        }
    }

    /// Codes the rotation rate as an angular rate in the Gaussian's own axes.
    fn code_angular_rate(
        &mut self,
        symbols: &mut impl Symbols,
        quantiser: &RotationQuantiser,
        support_radius: f64,
        target: Option<&Target>,
    ) {
        let q = self.row.rotation.map(f64::from);
        // Root mean square of |t - tau| over a symmetric span: the radius / sqrt 3.
        let time = Unit::new(0.577 * support_radius.max(1e-3));
        let [direction, roll] =
            [quantiser.direction_step, quantiser.roll_step].map(|step| Unit::new(0.5 * step).over(time));
        let number = target.map_or([0.0; 4], |t| {
            let [scalar, rest @ ..] = t.angular_rate;
            let [x, y, z] = rotation::rotate(rotation::inverse(q), rest);
            [scalar, x, y, z]
        });
        let finer = if direction.size < roll.size { direction } else { roll };
        let units = [finer, direction, direction, roll];
        let mut rate = [0.0; 4];
        for i in 0..4 {
            symbols.begin(Attribute::AngularRate, i);
            let code =
                self.angular_rate[i].code(symbols, &mut self.models, number[i], Coding::near(units[i], 0.0));
            rate[i] = f64::from(code) * units[i].size;
        }
        self.row.rotation_rate = product(q, rate).map(narrowed);
    }

    /// Codes colour and spherical harmonics.
    fn code_colors(
        &mut self,
        symbols: &mut impl Symbols,
        step: f64,
        target: Option<&Target>,
        history: &mut History,
    ) {
        let number = |k: usize| target.map_or([0.0; 3], |t| t.sh[k].map(f64::from));
        let color = luma_chroma(number(0).map(|x| x * SH_C0));
        let units = [COLOR, COLOR * CHROMA].map(|factor| Unit::new((step * factor).min(COLOR_STEP_MAX)));
        for (i, quantity) in self.colors.iter_mut().enumerate() {
            let unit = units[i.min(1)];
            let mean = quantity.mean();
            let offset =
                COLOR_NEIGHBOR_WEIGHT * (self.neighbors.mean(mean, |history| history.color[i]) - mean);
            symbols.begin(Attribute::Color, i);
            let coding = Coding { lambda: LAMBDA, ..Coding::near(unit, mean + offset) };
            let code = quantity.code(symbols, &mut self.models, color[i], coding);
            history.color[i] = f64::from(code) * unit.size;
        }
        self.row.sh[0] = rgb(history.color).map(|x| narrowed(math::in_units(x, SH_C0_UNIT)));

        let unit = Unit::new(math::in_units(SH * step, SH_C0_UNIT));
        let mut energy = Energy::default();
        for (k, quantities) in (1..).zip(self.harmonics.chunks_exact_mut(3)) {
            let opponents = opponents(number(k));
            let mut coded = [0.0; 3];
            for (i, quantity) in quantities.iter_mut().enumerate() {
                symbols.begin(Attribute::Harmonics, 3 * (k - 1) + i);
                coded[i] = f64::from(energy.code(
                    symbols,
                    &mut self.models,
                    quantity,
                    opponents[i],
                    unit,
                    SH_LAMBDA,
                )) * unit.size;
            }
            self.row.sh[k] = channels(coded).map(narrowed);
        }
    }
}

/// Upper bits of both coordinates of a direction that adapt. Format.
const DIRECTION_LEVELS: u32 = 4;

/// Quantisation step of the logarithm of the opacity.
pub(super) fn opacity_step(step: f64) -> f64 {
    (OPACITY * step).min(OPACITY_STEP_MAX)
}

/// The opacity of a coded number.
pub(super) fn decoded_opacity(number: f64) -> f32 {
    (math::exp(-number) as f32).min(1.0)
}

/// The window centre of a coded number.
pub(super) fn decoded_tau(number: f64) -> f32 {
    (0.5 + number) as f32
}

/// Size of a Gaussian, to which its position step is proportional.
fn size_of(extents: [f64; 3]) -> f64 {
    0.5 * (extents[0] * extents[1]).sqrt() + 0.5 * extents[2]
}

/// Quantisation step of the position, before the scales are rounded.
#[cfg(feature = "encode")]
pub(super) fn position_step(chunk: &Chunk, target: &Target) -> f64 {
    let step =
        f64::from(chunk.step) * half_octaves(target.visibility_index) * half_octaves(target.geometry_index);
    step * size_of(target.log_scales.map(|x| math::exp(log_extent(x, f64::from(chunk.footprint)))))
}

/// [`Target::angular_rate`] of a quaternion `q` and its rate.
#[cfg(feature = "encode")]
pub(super) fn angular_rate(q: [f64; 4], rate: [f64; 4]) -> [f64; 4] {
    let [scalar, rest @ ..] = product(rotation::inverse(q), rate);
    let [x, y, z] = rotation::rotate(q, rest);
    [scalar, x, y, z]
}

/// Logarithm of a standard deviation, given by its logarithm, once blurred by the footprint.
fn log_extent(log_scale: f64, footprint: f64) -> f64 {
    let sigma = math::exp(log_scale);
    0.5 * math::ln(sigma * sigma + footprint * footprint)
}

/// Ratio of coded to expected magnitudes in a Gaussian, which predicts its next numbers.
#[derive(Default)]
struct Energy {
    coded: f64,
    expected: f64,
}

impl Energy {
    fn code(
        &mut self,
        symbols: &mut impl Symbols,
        models: &mut [TokenInteger],
        quantity: &mut Quantity,
        number: f64,
        unit: Unit,
        lambda: f64,
    ) -> i32 {
        let expected = quantity.expected(unit);
        let weight = expected.max(0.05);
        let spread = [self.coded + weight, self.expected + weight];
        let code = quantity.code(symbols, models, number, Coding { unit, prediction: 0.0, spread, lambda });
        self.coded += f64::from(code.unsigned_abs());
        self.expected += expected;
        code
    }
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

/// The roll that brings the first axis nearest to `axis`. Runs in the encoder only, so the last bits
/// of the arc tangent may differ between machines.
fn roll_code(direction: [f64; 3], axis: [f64; 3], codes: u32) -> u32 {
    let [x, y] =
        rotation::roll_axes(direction).map(|e: [f64; 3]| e[0] * axis[0] + e[1] * axis[1] + e[2] * axis[2]);
    let turn = (libm::atan2(y, x) / std::f64::consts::PI).rem_euclid(1.0);
    ((turn * f64::from(codes)) as u32).min(codes - 1)
}
