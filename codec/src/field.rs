//! [`Field`]: 4D Gaussians as a structure of arrays, with the paper's two equations, trajectory and
//! temporal opacity.
//!
//! Row `i` of every column describes Gaussian `i`. Columns that a field does not need are absent:
//! a static field has no [`Temporal`], a field without view-dependent colour has SH degree 0.
//! Lengths are in the units of the source. Clip time `t` is 0 at the start of the clip and 1 at its
//! end.

use crate::PixelFilter;
use crate::counters::Work;

/// Opacity below which a Gaussian is not drawn: one step of an 8-bit pixel.
pub const ALPHA_MIN: f64 = 1.0 / 255.0;

/// Highest supported degree of the spherical harmonics.
pub const SH_DEGREE_MAX: u8 = 3;

/// Highest supported power of time in a trajectory.
pub const MOTION_ORDER_MAX: u8 = 3;

/// Largest magnitude of a number in the field of a package, in its unit. Decoded numbers and their cubic sums stay finite.
pub const MAGNITUDE_MAX: f32 = 1e9;

/// Value of the constant spherical harmonic, `1 / (2 sqrt(pi))`. At degree 0 the colour of a
/// Gaussian is `0.5 + SH_C0 * c_0`.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Number of spherical-harmonic coefficients per colour channel: `(degree + 1)^2`.
pub const fn sh_coefficients(degree: u8) -> usize {
    (degree as usize + 1) * (degree as usize + 1)
}

/// A set of 4D Gaussians, one row each in every column.
///
/// Invariants, which [`Field::check`] verifies and most methods assume: the lengths of all columns
/// match; every number is finite, except that a window width may be `+inf` (always on); quaternions
/// have unit length; opacities lie in `[0, 1]`; window widths are positive. Methods that take the
/// number of a row panic if it is out of range.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Field {
    /// Centres mu in source units: the positions at `t = tau`, at all times for a static field.
    pub centers: Vec<[f32; 3]>,
    /// Unit quaternions `w, x, y, z` that rotate the Gaussian's axes to world axes.
    pub rotations: Vec<[f32; 4]>,
    /// Natural logarithms of the standard deviations along the Gaussian's axes, in source units.
    pub log_scales: Vec<[f32; 3]>,
    /// Peak opacities o, in `[0, 1]`.
    pub opacities: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to [`SH_DEGREE_MAX`].
    pub sh_degree: u8,
    /// Spherical-harmonic coefficients `[gaussian][coefficient][red, green, blue]`, the first two
    /// dimensions flattened: `len * sh_coefficients(sh_degree)` entries. The display-referred colour
    /// is `max(0.5 + sum(Y_k c_k), 0)`, with the basis order and signs of 3D Gaussian Splatting.
    pub sh: Vec<[f32; 3]>,
    /// The filter that the Gaussians are drawn with.
    pub filter: PixelFilter,
    /// Depth in front of an eye, in source units, from which on Gaussians are drawn whole; nearer ones fade, see
    /// [`near_fade`](crate::near_fade). Finite, not negative; 0 if none fades.
    pub near: f32,
    /// Windows and motion; absent if every Gaussian is always on and motionless.
    pub temporal: Option<Temporal>,
}

/// The columns of a field that changes over time: temporal windows, motion and rotation rates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Temporal {
    /// Window centres tau in clip time. May lie outside `[0, 1]`.
    pub tau: Vec<f32>,
    /// Window widths s: standard deviations in clip time, positive, `+inf` for always on.
    pub s: Vec<f32>,
    /// Highest power of time in the trajectories, 0 to [`MOTION_ORDER_MAX`].
    pub motion_order: u8,
    /// Motion coefficients v1, v2, v3 in source units per power of clip time: `[gaussian][power - 1]`
    /// flattened, `len * motion_order` entries.
    pub motion: Vec<[f32; 3]>,
    /// Rotation rates: derivatives `w, x, y, z` of the quaternion per unit of clip time, so that
    /// `q(t) = normalise(q + rate (t - tau))` as in Spacetime Gaussians (Li et al. 2024). Not in the
    /// paper; absent if no Gaussian rotates.
    pub rotation_rates: Option<Vec<[f32; 4]>>,
}

impl Field {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.centers.len()
    }

    /// Whether the field has no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.centers.is_empty()
    }

    /// Highest power of time in the trajectories; 0 for a static field.
    pub fn motion_order(&self) -> u8 {
        self.temporal.as_ref().map_or(0, |temporal| temporal.motion_order)
    }

    /// Spherical-harmonic coefficients of Gaussian `i`: `sh_coefficients(sh_degree)` entries, the
    /// constant term first.
    pub fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        let count = sh_coefficients(self.sh_degree);
        &self.sh[i * count..(i + 1) * count]
    }

    /// Position of Gaussian `i` at clip time `t` in source units: `mu + v1 d + v2 d^2 + v3 d^3` with
    /// `d = t - tau`, the paper's trajectory (`eq::traj`).
    pub fn position_at(&self, i: usize, t: f64) -> [f64; 3] {
        let center = self.centers[i].map(f64::from);
        let Some(temporal) = &self.temporal else {
            return center;
        };
        let d = t - f64::from(temporal.tau[i]);
        let mut offset = [0.0; 3];
        for v in temporal.motion_of(i).iter().rev() {
            for axis in 0..3 {
                offset[axis] = (offset[axis] + f64::from(v[axis])) * d;
            }
        }
        [center[0] + offset[0], center[1] + offset[1], center[2] + offset[2]]
    }

    /// Opacity of Gaussian `i` at clip time `t`: `o exp(-(t - tau)^2 / (2 s^2))`, the paper's temporal
    /// opacity (`eq::topacity`).
    pub fn opacity_at(&self, i: usize, t: f64) -> f64 {
        let opacity = f64::from(self.opacities[i]);
        let Some(temporal) = &self.temporal else {
            return opacity;
        };
        let z = (t - f64::from(temporal.tau[i])) / f64::from(temporal.s[i]);
        opacity * libm::exp(-0.5 * z * z)
    }

    /// Unit quaternion `w, x, y, z` of Gaussian `i` at clip time `t`; see
    /// [`Temporal::rotation_rates`].
    pub fn rotation_at(&self, i: usize, t: f64) -> [f64; 4] {
        let mut q = self.rotations[i].map(f64::from);
        if let Some(temporal) = &self.temporal
            && let Some(rates) = &temporal.rotation_rates
        {
            let d = t - f64::from(temporal.tau[i]);
            for k in 0..4 {
                q[k] += f64::from(rates[i][k]) * d;
            }
        }
        let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
        // The sum can be zero at one instant; any rotation will do there.
        if norm > 1e-12 { q.map(|c| c / norm) } else { [1.0, 0.0, 0.0, 0.0] }
    }

    /// Alive interval of Gaussian `i`: the clip times in `[0, 1]` at which its opacity is at least
    /// [`ALPHA_MIN`], `tau -+ s sqrt(2 ln(o / ALPHA_MIN))`. `None` if it is never alive.
    pub fn alive_interval(&self, i: usize) -> Option<(f64, f64)> {
        let (start, end) = self.life(i)?;
        let (start, end) = (start.max(0.0), end.min(1.0));
        (start <= end).then_some((start, end))
    }

    /// [`Field::alive_interval`], not cut to the clip: the clip times between which the opacity of Gaussian `i` is at
    /// least [`ALPHA_MIN`], infinite for one that is always on. `None` if it is never alive.
    pub fn life(&self, i: usize) -> Option<(f64, f64)> {
        let opacity = f64::from(self.opacities[i]);
        if opacity < ALPHA_MIN {
            return None;
        }
        let always = Some((f64::NEG_INFINITY, f64::INFINITY));
        let Some(temporal) = &self.temporal else { return always };
        let (tau, s) = (f64::from(temporal.tau[i]), f64::from(temporal.s[i]));
        if s.is_infinite() {
            return always;
        }
        // The time index of a package depends on this interval, so every machine must compute the
        // same one: libm, not the system's logarithm.
        let support_radius = s * (2.0 * libm::log(opacity / ALPHA_MIN)).sqrt();
        Some((tau - support_radius, tau + support_radius))
    }

    /// Corners `[min, max]` of the box around all positions while alive, in source units, to within
    /// `f32` rounding. If no Gaussian is ever alive, of the box around the centres; the origin for an
    /// empty field.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let mut boxes = (0..self.len()).filter_map(|i| self.path_bounds(i)).peekable();
        let bounds = match boxes.peek() {
            Some(_) => boxes.reduce(union),
            None => self.centers.iter().map(|center| [center.map(f64::from); 2]).reduce(union),
        };
        bounds.unwrap_or_default().map(|corner| corner.map(|x| x as f32))
    }

    /// Corners `[min, max]` of the box around the positions of Gaussian `i` while alive, in source units;
    /// `None` if it is never alive.
    pub fn path_bounds(&self, i: usize) -> Option<[[f64; 3]; 2]> {
        let (start, end) = self.alive_interval(i)?;
        let turning = self.turning_times(i).into_iter().filter(|t| (start..end).contains(t));
        [start, end].into_iter().chain(turning).map(|t| [self.position_at(i, t); 2]).reduce(union)
    }

    /// Clip times at which Gaussian `i` reverses along an axis: the roots of
    /// `v1 + 2 v2 d + 3 v3 d^2`, at most two per axis.
    fn turning_times(&self, i: usize) -> Vec<f64> {
        let Some(temporal) = &self.temporal else {
            return Vec::new();
        };
        let v = |power: usize, axis: usize| {
            temporal.motion_of(i).get(power - 1).map_or(0.0, |v| f64::from(v[axis]))
        };
        let roots = |axis: usize| {
            let (a, b, c) = (3.0 * v(3, axis), 2.0 * v(2, axis), v(1, axis));
            // This pairing keeps both roots accurate if `a` is small against `b`.
            let q = -0.5 * (b + (b * b - 4.0 * a * c).sqrt().copysign(b));
            [q / a, c / q].into_iter().filter(|d| d.is_finite())
        };
        (0..3).flat_map(roots).map(|d| f64::from(temporal.tau[i]) + d).collect()
    }

    /// Returns a field of the given rows, in that order, with the same columns.
    ///
    /// # Panics
    /// If a row is out of range.
    pub fn select(&self, rows: &[usize]) -> Field {
        let pick3 = |column: &[[f32; 3]]| rows.iter().map(|&i| column[i]).collect::<Vec<_>>();
        let groups = |column: &[[f32; 3]], size: usize| {
            rows.iter().flat_map(|&i| column[i * size..(i + 1) * size].iter().copied()).collect()
        };
        Field {
            centers: pick3(&self.centers),
            rotations: rows.iter().map(|&i| self.rotations[i]).collect(),
            log_scales: pick3(&self.log_scales),
            opacities: rows.iter().map(|&i| self.opacities[i]).collect(),
            sh_degree: self.sh_degree,
            sh: groups(&self.sh, sh_coefficients(self.sh_degree)),
            filter: self.filter,
            near: self.near,
            temporal: self.temporal.as_ref().map(|temporal| Temporal {
                tau: rows.iter().map(|&i| temporal.tau[i]).collect(),
                s: rows.iter().map(|&i| temporal.s[i]).collect(),
                motion_order: temporal.motion_order,
                motion: groups(&temporal.motion, temporal.motion_order as usize),
                rotation_rates: temporal
                    .rotation_rates
                    .as_ref()
                    .map(|rates| rows.iter().map(|&i| rates[i]).collect()),
            }),
        }
    }

    /// Replaces `rows` by the rows of `from`, in that order. Columns that `from` lacks become zeros; without temporal
    /// columns, its Gaussians are always on. Columns that `self` lacks are left out.
    ///
    /// # Panics
    /// If a row is out of range, or `from` has not as many.
    #[cfg(feature = "encode")]
    pub(crate) fn set_rows(&mut self, rows: &[usize], from: &Field) {
        assert_eq!(rows.len(), from.len(), "a row for each");
        let sh = sh_coefficients(self.sh_degree);
        for (k, &i) in rows.iter().enumerate() {
            self.centers[i] = from.centers[k];
            self.rotations[i] = from.rotations[k];
            self.log_scales[i] = from.log_scales[k];
            self.opacities[i] = from.opacities[k];
            set_group(&mut self.sh[i * sh..(i + 1) * sh], from.sh_of(k));
            let Some(temporal) = &mut self.temporal else { continue };
            let value = |column: fn(&Temporal) -> &[f32], default| {
                from.temporal.as_ref().map_or(default, |t| column(t)[k])
            };
            temporal.tau[i] = value(|t| &t.tau, 0.5);
            temporal.s[i] = value(|t| &t.s, f32::INFINITY);
            let order = usize::from(temporal.motion_order);
            let motion = from.temporal.as_ref().map_or(&[][..], |t| t.motion_of(k));
            set_group(&mut temporal.motion[i * order..(i + 1) * order], motion);
            if let Some(rates) = &mut temporal.rotation_rates {
                let from = from.temporal.as_ref().and_then(|t| t.rotation_rates.as_ref());
                rates[i] = from.map_or([0.0; 4], |rates| rates[k]);
            }
        }
    }

    /// Adds the rows of `further`, which has the same columns.
    ///
    /// # Panics
    /// If it has others.
    pub(crate) fn append(&mut self, further: Field) {
        fn append<T>(column: &mut Vec<T>, mut further: Vec<T>) {
            column.reserve_exact(further.len());
            column.append(&mut further);
        }
        assert!(self.has_columns_of(&further), "further rows have the same columns");
        append(&mut self.centers, further.centers);
        append(&mut self.rotations, further.rotations);
        append(&mut self.log_scales, further.log_scales);
        append(&mut self.opacities, further.opacities);
        append(&mut self.sh, further.sh);
        if let (Some(temporal), Some(further)) = (&mut self.temporal, further.temporal) {
            append(&mut temporal.tau, further.tau);
            append(&mut temporal.s, further.s);
            append(&mut temporal.motion, further.motion);
            if let (Some(rates), Some(further)) = (&mut temporal.rotation_rates, further.rotation_rates) {
                append(rates, further);
            }
        }
    }

    /// Whether `other` has the columns, the filter and the near distance of this field.
    pub(crate) fn has_columns_of(&self, other: &Field) -> bool {
        let columns = |field: &Field| {
            let temporal = field.temporal.as_ref();
            let temporal =
                temporal.map(|temporal| (temporal.motion_order, temporal.rotation_rates.is_some()));
            (field.sh_degree, field.filter, field.near.to_bits(), temporal)
        };
        columns(self) == columns(other)
    }

    /// Moves row `first + i` to row `first + positions[i]`, for each of `positions`, a permutation of the numbers below
    /// its length. `scratch` has the same length.
    pub(crate) fn move_rows(&mut self, first: usize, positions: &[u32], scratch: &mut [u32]) {
        Work::Rows.count(positions.len());
        let Field { centers, rotations, log_scales, opacities, sh_degree, sh, filter: _, near: _, temporal } =
            self;
        let mut columns = vec![
            (centers.as_flattened_mut(), 3),
            (rotations.as_flattened_mut(), 4),
            (log_scales.as_flattened_mut(), 3),
            (opacities, 1),
            (sh.as_flattened_mut(), 3 * sh_coefficients(*sh_degree)),
        ];
        if let Some(Temporal { tau, s, motion_order, motion, rotation_rates }) = temporal {
            let motion = (motion.as_flattened_mut(), 3 * usize::from(*motion_order));
            columns.extend([(&mut tau[..], 1), (s, 1), motion]);
            columns.extend(rotation_rates.as_mut().map(|rates| (rates.as_flattened_mut(), 4)));
        }
        for (numbers, row_len) in columns {
            let numbers = &mut numbers[first * row_len..];
            // One number of each row at a time: they fit into the cache.
            for k in 0..row_len {
                let rows = numbers.iter().skip(k).step_by(row_len);
                scratch.iter_mut().zip(rows).for_each(|(copy, number)| *copy = number.to_bits());
                for (&position, &number) in positions.iter().zip(&*scratch) {
                    numbers[position as usize * row_len + k] = f32::from_bits(number);
                }
            }
        }
    }

    /// Checks the invariants of the type.
    ///
    /// # Errors
    /// One sentence that names the first invalid column and row.
    pub fn check(&self) -> Result<(), String> {
        let n = self.len();
        if self.sh_degree > SH_DEGREE_MAX {
            return Err(format!("SH degree {} is above {SH_DEGREE_MAX}", self.sh_degree));
        }
        if !(self.near >= 0.0 && self.near.is_finite()) {
            return Err(format!("near distance {} is not a finite number from 0 up", self.near));
        }
        let length = |name: &str, len: usize, expected: usize| {
            if len == expected {
                Ok(())
            } else {
                Err(format!("column {name} has {len} entries, {expected} expected"))
            }
        };
        length("rotations", self.rotations.len(), n)?;
        length("log_scales", self.log_scales.len(), n)?;
        length("opacities", self.opacities.len(), n)?;
        length("sh", self.sh.len(), n * sh_coefficients(self.sh_degree))?;
        check_rows("centers", &self.centers, |v| v.iter().all(|x| x.is_finite()))?;
        check_rows("rotations", &self.rotations, |q| {
            (q.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-3
        })?;
        check_rows("log_scales", &self.log_scales, |v| v.iter().all(|x| x.is_finite()))?;
        check_rows("opacities", &self.opacities, |o| (0.0..=1.0).contains(o))?;
        check_rows("sh", &self.sh, |v| v.iter().all(|x| x.is_finite()))?;
        let Some(temporal) = &self.temporal else {
            return Ok(());
        };
        if temporal.motion_order > MOTION_ORDER_MAX {
            return Err(format!("motion order {} is above {MOTION_ORDER_MAX}", temporal.motion_order));
        }
        length("tau", temporal.tau.len(), n)?;
        length("s", temporal.s.len(), n)?;
        length("motion", temporal.motion.len(), n * temporal.motion_order as usize)?;
        check_rows("tau", &temporal.tau, |x| x.is_finite())?;
        check_rows("s", &temporal.s, |&x| x > 0.0)?;
        check_rows("motion", &temporal.motion, |v| v.iter().all(|x| x.is_finite()))?;
        if let Some(rates) = &temporal.rotation_rates {
            length("rotation_rates", rates.len(), n)?;
            check_rows("rotation_rates", rates, |v| v.iter().all(|x| x.is_finite()))?;
        }
        Ok(())
    }
}

impl Temporal {
    /// Motion coefficients v1, v2, ... of Gaussian `i`: `motion_order` entries.
    pub fn motion_of(&self, i: usize) -> &[[f32; 3]] {
        let order = self.motion_order as usize;
        &self.motion[i * order..(i + 1) * order]
    }

    /// Whether Gaussian `i` neither moves nor rotates.
    pub fn is_motionless(&self, i: usize) -> bool {
        self.motion_of(i).iter().all(|v| *v == [0.0; 3])
            && self.rotation_rates.as_ref().is_none_or(|rates| rates[i] == [0.0; 4])
    }
}

/// The box around two boxes `[min, max]`.
fn union(a: [[f64; 3]; 2], b: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
    [
        std::array::from_fn(|axis| a[0][axis].min(b[0][axis])),
        std::array::from_fn(|axis| a[1][axis].max(b[1][axis])),
    ]
}

fn check_rows<T>(name: &str, rows: &[T], valid: impl Fn(&T) -> bool) -> Result<(), String> {
    match rows.iter().position(|row| !valid(row)) {
        Some(row) => Err(format!("column {name}, row {row}: value out of range")),
        None => Ok(()),
    }
}

/// Copies a group of numbers of one row, filled up with zeros or cut.
#[cfg(feature = "encode")]
fn set_group(to: &mut [[f32; 3]], from: &[[f32; 3]]) {
    to.fill([0.0; 3]);
    to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two Gaussians with all columns.
    fn field() -> Field {
        Field {
            centers: vec![[1.0, 2.0, 3.0], [-1.0, 0.0, 0.5]],
            rotations: vec![[0.5, 0.5, 0.5, 0.5], [1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-3.0; 3], [-2.0, -4.0, -5.0]],
            opacities: vec![0.8, 0.3],
            sh_degree: 1,
            sh: (0..8).map(|i| [i as f32; 3]).collect(),
            filter: PixelFilter::Mip,
            near: 0.5,
            temporal: Some(Temporal {
                tau: vec![0.4, 0.9],
                s: vec![0.1, f32::INFINITY],
                motion_order: 3,
                motion: vec![
                    [1.0, -2.0, 0.5],
                    [3.0, 0.0, -4.0],
                    [-5.0, 6.0, 7.0],
                    [0.5, 0.0, 0.0],
                    [0.0, 0.25, 0.0],
                    [0.0, 0.0, -2.0],
                ],
                rotation_rates: Some(vec![[0.0, 1.0, 0.0, 0.0], [0.0; 4]]),
            }),
        }
    }

    #[test]
    fn trajectory_passes_through_its_centre_with_the_given_derivatives() {
        let field = field();
        let tau = f64::from(field.temporal.as_ref().unwrap().tau[0]);
        assert_eq!(field.position_at(0, tau), [1.0, 2.0, 3.0]);
        // Central differences of a cubic: exact for the second derivative, off by v3 h^2 for the
        // first derivative.
        let h = 1e-3;
        let at = |d: f64| field.position_at(0, tau + d);
        for axis in 0..3 {
            let v = |power: usize| f64::from(field.temporal.as_ref().unwrap().motion_of(0)[power - 1][axis]);
            let first = (at(h)[axis] - at(-h)[axis]) / (2.0 * h);
            assert!((first - v(1) - v(3) * h * h).abs() < 1e-9, "axis {axis}: {first}");
            let second = (at(h)[axis] - 2.0 * at(0.0)[axis] + at(-h)[axis]) / (h * h);
            assert!((second - 2.0 * v(2)).abs() < 1e-7, "axis {axis}: {second}");
            let third = (at(2.0 * h)[axis] - 2.0 * at(h)[axis] + 2.0 * at(-h)[axis] - at(-2.0 * h)[axis])
                / (2.0 * h * h * h);
            assert!((third - 6.0 * v(3)).abs() < 1e-4, "axis {axis}: {third}");
        }
    }

    #[test]
    fn opacity_is_the_gaussian_window() {
        let field = field();
        let (tau, s) = (f64::from(0.4f32), f64::from(0.1f32));
        let peak = f64::from(0.8f32);
        assert_eq!(field.opacity_at(0, tau), peak);
        for d in [-0.3, -0.1, 0.05, 0.2] {
            let expected = peak * (-(d * d) / (2.0 * s * s)).exp();
            assert!((field.opacity_at(0, tau + d) - expected).abs() < 1e-12);
            // The derivative in closed form: -d / s^2 o(t).
            let h = 1e-5;
            let slope = (field.opacity_at(0, tau + d + h) - field.opacity_at(0, tau + d - h)) / (2.0 * h);
            assert!((slope + d / (s * s) * expected).abs() < 1e-6, "{slope}");
        }
        for t in [-5.0, 0.0, 1.0, 70.0] {
            assert_eq!(field.opacity_at(1, t), f64::from(0.3f32), "an infinite window is always on");
        }
    }

    #[test]
    fn rotation_is_linear_in_time_and_normalised() {
        let field = field();
        let tau = f64::from(0.4f32);
        let q = field.rotation_at(0, tau + 0.5);
        let norm = (0.25f64 + 1.0 + 0.25 + 0.25).sqrt();
        for (actual, expected) in q.iter().zip([0.5, 1.0, 0.5, 0.5].map(|x: f64| x / norm)) {
            assert!((actual - expected).abs() < 1e-12, "{q:?}");
        }
        assert_eq!(field.rotation_at(1, 0.0), [1.0, 0.0, 0.0, 0.0]);
        let mut vanishing = field;
        vanishing.rotations[0] = [0.0, 1.0, 0.0, 0.0];
        let rotation = vanishing.rotation_at(0, tau - 1.0);
        assert_eq!(rotation, [1.0, 0.0, 0.0, 0.0], "the quaternion passes through zero");
    }

    #[test]
    fn a_static_field_never_changes() {
        let field = Field { temporal: None, ..field() };
        for t in [0.0, 0.3, 1.0] {
            assert_eq!(field.position_at(0, t), [1.0, 2.0, 3.0]);
            assert_eq!(field.opacity_at(0, t), f64::from(0.8f32));
            assert_eq!(field.rotation_at(0, t), [0.5; 4]);
        }
        assert_eq!(field.alive_interval(0), Some((0.0, 1.0)));
        assert_eq!(field.motion_order(), 0);
    }

    #[test]
    fn alive_interval_ends_where_opacity_reaches_the_threshold() {
        let mut field = field();
        let (start, end) = field.alive_interval(0).unwrap();
        assert!(start > 0.0 && end < 1.0);
        for t in [start, end] {
            assert!((field.opacity_at(0, t) / ALPHA_MIN - 1.0).abs() < 1e-9);
        }
        assert_eq!(field.alive_interval(1), Some((0.0, 1.0)));
        let temporal = field.temporal.as_mut().unwrap();
        temporal.tau = vec![-0.2, 1.5];
        temporal.s = vec![0.1, 0.1];
        assert_eq!(field.alive_interval(0).unwrap().0, 0.0, "cut to the clip");
        assert_eq!(field.alive_interval(1), None, "its window lies outside the clip");
        field.opacities = vec![1.0 / 256.0, 0.0];
        assert_eq!((field.alive_interval(0), field.alive_interval(1)), (None, None), "too faint");
    }

    #[test]
    fn bounds_are_tight_around_alive_positions() {
        let field = field();
        let [low, high] = field.bounds();
        let (mut expected_low, mut expected_high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for i in 0..field.len() {
            let (start, end) = field.alive_interval(i).unwrap();
            for step in 0..=10_000 {
                let position = field.position_at(i, start + (end - start) * f64::from(step) / 10_000.0);
                for axis in 0..3 {
                    expected_low[axis] = expected_low[axis].min(position[axis]);
                    expected_high[axis] = expected_high[axis].max(position[axis]);
                }
            }
        }
        for axis in 0..3 {
            assert!((f64::from(low[axis]) - expected_low[axis]).abs() < 1e-5, "{low:?} {expected_low:?}");
            assert!((f64::from(high[axis]) - expected_high[axis]).abs() < 1e-5, "{high:?} {expected_high:?}");
        }
    }

    #[test]
    fn bounds_of_invisible_and_empty_fields() {
        let mut field = Field { temporal: None, ..field() };
        let visible = field.bounds();
        assert_eq!(visible, [[-1.0, 0.0, 0.5], [1.0, 2.0, 3.0]]);
        field.opacities = vec![0.0; 2];
        assert_eq!(field.bounds(), visible);
        assert_eq!(Field::default().bounds(), [[0.0; 3]; 2]);
    }

    #[test]
    fn select_copies_all_columns() {
        let field = field();
        let picked = field.select(&[1, 0, 1]);
        assert_eq!(picked.check(), Ok(()));
        assert_eq!((picked.len(), picked.filter), (3, field.filter));
        for (row, source) in [1, 0, 1].into_iter().enumerate() {
            assert_eq!(picked.centers[row], field.centers[source]);
            assert_eq!(picked.rotations[row], field.rotations[source]);
            assert_eq!(picked.log_scales[row], field.log_scales[source]);
            assert_eq!(picked.opacities[row], field.opacities[source]);
            assert_eq!(picked.sh_of(row), field.sh_of(source));
            let (a, b) = (picked.temporal.as_ref().unwrap(), field.temporal.as_ref().unwrap());
            assert_eq!((a.tau[row], a.s[row]), (b.tau[source], b.s[source]));
            assert_eq!(a.motion_of(row), b.motion_of(source));
            assert_eq!(a.rotation_rates.as_ref().unwrap()[row], b.rotation_rates.as_ref().unwrap()[source]);
            assert_eq!(a.is_motionless(row), b.is_motionless(source));
        }
        assert!(field.select(&[]).is_empty());
    }

    #[test]
    fn motionless_means_neither_moving_nor_rotating() {
        let mut temporal = field().temporal.unwrap();
        assert!(!temporal.is_motionless(0) && !temporal.is_motionless(1));
        temporal.motion.fill([0.0; 3]);
        assert!(!temporal.is_motionless(0), "it rotates");
        assert!(temporal.is_motionless(1));
        temporal.rotation_rates = None;
        assert!(temporal.is_motionless(0));
    }

    /// Checks that `change` makes the field invalid, with a message that contains `expected`.
    #[track_caller]
    fn refused(expected: &str, change: impl FnOnce(&mut Field)) {
        let mut bad = field();
        change(&mut bad);
        let message = bad.check().expect_err(expected);
        assert!(message.contains(expected), "'{expected}' expected: {message}");
    }

    #[test]
    fn check_names_column_and_row() {
        assert_eq!(field().check(), Ok(()));
        assert_eq!(Field::default().check(), Ok(()));
        fn temporal(field: &mut Field) -> &mut Temporal {
            field.temporal.as_mut().unwrap()
        }
        refused("SH degree 4", |f| f.sh_degree = 4);
        refused("motion order 4", |f| temporal(f).motion_order = 4);
        refused("rotations has 1", |f| f.rotations.truncate(1));
        refused("log_scales has 3", |f| f.log_scales.push([0.0; 3]));
        refused("opacities has 1", |f| f.opacities.truncate(1));
        refused("sh has 8 entries, 18", |f| f.sh_degree = 2);
        refused("tau has 0", |f| temporal(f).tau.clear());
        refused("s has 1", |f| temporal(f).s.truncate(1));
        refused("motion has 6 entries, 4", |f| temporal(f).motion_order = 2);
        refused("rotation_rates has 0", |f| temporal(f).rotation_rates = Some(Vec::new()));
        refused("centers, row 1", |f| f.centers[1][2] = f32::NAN);
        refused("rotations, row 0", |f| f.rotations[0] = [0.5, 0.5, 0.5, 0.6]);
        refused("rotations, row 0", |f| f.rotations[0] = [f32::NAN; 4]);
        refused("log_scales, row 1", |f| f.log_scales[1][0] = f32::NEG_INFINITY);
        refused("opacities, row 0", |f| f.opacities[0] = 1.01);
        refused("opacities, row 0", |f| f.opacities[0] = -0.01);
        refused("opacities, row 0", |f| f.opacities[0] = f32::NAN);
        refused("sh, row 5", |f| f.sh[5][1] = f32::INFINITY);
        refused("tau, row 1", |f| temporal(f).tau[1] = f32::INFINITY);
        refused("s, row 0", |f| temporal(f).s[0] = 0.0);
        refused("s, row 0", |f| temporal(f).s[0] = f32::NAN);
        refused("motion, row 3", |f| temporal(f).motion[3][0] = f32::NAN);
        refused("rotation_rates, row 1", |f| temporal(f).rotation_rates.as_mut().unwrap()[1][3] = f32::NAN);
    }
}
