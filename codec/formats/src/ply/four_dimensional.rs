//! PLY of 4DGS (Yang et al. 2024, "Real-time Photorealistic Dynamic Scene Representation and Rendering with 4D Gaussian
//! Splatting"): Gaussians in space and time.
//!
//! The columns of 3D Gaussian Splatting, and: `t`, the centre in time; `scale_t` (or `scale_t_0`), the logarithm of the
//! standard deviation along the fourth axis; `rot_0..3` and `rot_r_0..3`, the left and the right quaternion of the
//! rotation in four dimensions. With the covariance `[A b; b' c]` of space and time, the Gaussian of an instant moves
//! by `b / c`, is `A - b b' / c` wide, and fades with the variance `c`: a linear motion, a constant shape and a window.

use codec::Field;

use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::similarity::quaternion;

use super::container::Table;
use super::gaussian_splatting;

/// Names of the right quaternion.
const RIGHT: [&str; 4] = ["rot_r_0", "rot_r_1", "rot_r_2", "rot_r_3"];

/// Name of the scale along time, by two programs.
const SCALE_T: [&str; 2] = ["scale_t", "scale_t_0"];

/// Share of a clip by which the centres in time reach beyond it on both sides: where the points of a capture have no time,
/// fits begin with times at random within that range.
const MARGIN: f64 = 0.1;

/// Rounds of Jacobi's method: each squares the error.
const ROUNDS: usize = 8;

/// Whether a table has the columns of this format.
pub(super) fn is_one(vertex: &Table) -> bool {
    vertex.has("t") && vertex.has(RIGHT[0]) && SCALE_T.iter().any(|name| vertex.has(name))
}

/// Reads the rows of a dynamic field.
pub(super) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let mut imported = gaussian_splatting::read(vertex, budget)?;
    let name = SCALE_T.into_iter().find(|name| vertex.has(name)).unwrap_or(SCALE_T[0]);
    let [time, scale_t] = vertex.find(["t", name])?;
    let right = vertex.find(RIGHT)?;
    let times = (0..vertex.rows).map(|row| vertex.get(row, time)).filter(|time| time.is_finite());
    let ends = times.fold(None, |ends: Option<(f64, f64)>, time| {
        Some(ends.map_or((time, time), |(first, last)| (first.min(time), last.max(time))))
    });
    let (first, last) = ends.unwrap_or_default();
    let span = Span::new(first.min(0.0), last.max(0.0));
    let mut temporal = budget.temporal(vertex.rows, 1)?;
    let Field { rotations, log_scales, .. } = &mut imported.field;
    for row in 0..vertex.rows {
        let scales = log_scales[row].map(f64::from);
        let scales = [scales[0], scales[1], scales[2], vertex.get(row, scale_t)].map(f64::exp);
        let left = rotations[row].map(f64::from);
        let covariance = covariance(scales, left, right.map(|column| vertex.get(row, column)));
        let variance = covariance[3][3];
        let along = [0, 1, 2].map(|axis| covariance[axis][3]);
        let shape = [0, 1, 2].map(|a| [0, 1, 2].map(|b| covariance[a][b] - along[a] * along[b] / variance));
        let (axes, variances) = principal_axes(shape);
        rotations[row] = quaternion(axes).map(|x| x as f32);
        log_scales[row] = variances.map(|variance| (0.5 * variance.max(0.0).ln()) as f32);
        temporal.tau.push(((vertex.get(row, time) - span.start) / span.length) as f32);
        temporal.s.push((variance.sqrt() / span.length) as f32);
        temporal.motion.push(along.map(|x| (x / variance * span.length) as f32));
    }
    imported.field.temporal = Some(temporal);
    imported.hints.duration_s = span.duration_s();
    imported.account.assumed.push(format!(
        "times from {} to {} are the clip, which the format does not state: its Gaussians are at times from {} to {}, and \
         fits begin with a tenth more than the clip before and behind it",
        span.start,
        span.start + span.length,
        first as f32,
        last as f32
    ));
    Ok(Imported { format: "4DGS PLY", ..imported })
}

/// The times of a clip, in the unit of a file.
struct Span {
    start: f64,
    length: f64,
}

impl Span {
    /// The span of a file with centres in time between these: one of the two that configurations of the format have
    /// without a unit, if it holds them with the margin, otherwise whole seconds, less the margin where there is one.
    fn new(first: f64, last: f64) -> Span {
        let holds = |span: &Span| {
            let slack = MARGIN * span.length;
            span.start - slack <= first && last <= span.start + span.length + slack
        };
        let units = [Span { start: 0.0, length: 1.0 }, Span { start: -0.5, length: 1.0 }];
        units.into_iter().find(holds).unwrap_or_else(|| {
            let within = Span { start: 0.0, length: (last / (1.0 + MARGIN)).round() };
            // Fits move times: a margin of half the size is none. A clip that is not of whole seconds may end later.
            let is_margin = (first / within.length + MARGIN).abs() < 0.5 * MARGIN;
            if is_margin && last <= within.length * (1.0 + 1.5 * MARGIN) {
                return within;
            }
            let start = first.floor();
            Span { start, length: (last.ceil() - start).max(1.0) }
        })
    }

    /// Its length in seconds, if it has a unit.
    fn duration_s(&self) -> Option<f32> {
        (self.length > 1.0).then_some(self.length as f32)
    }
}

/// The covariance in x, y, z, t with these standard deviations before the rotation by two quaternions w, x, y, z of any
/// length.
fn covariance(scales: [f64; 4], left: [f64; 4], right: [f64; 4]) -> [[f64; 4]; 4] {
    let [[a, b, c, d], [p, q, r, s]] = [left, right].map(|x| {
        let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
        x.map(|x| x / norm)
    });
    let by_left = [[a, -b, -c, -d], [b, a, -d, c], [c, d, a, -b], [d, -c, b, a]];
    let by_right = [[p, q, r, s], [-q, p, -s, r], [-r, s, p, -q], [-s, -r, q, p]];
    // The quaternions' real axis is time: rows and columns are in the opposite order.
    let rotation = |i: usize, j: usize| (0..4).map(|k| by_left[3 - i][k] * by_right[k][3 - j]).sum::<f64>();
    let columns: [[f64; 4]; 4] = std::array::from_fn(|j| std::array::from_fn(|i| scales[j] * rotation(i, j)));
    std::array::from_fn(|i| std::array::from_fn(|j| columns.iter().map(|column| column[i] * column[j]).sum()))
}

/// The axes of a symmetric matrix as the columns of a rotation, and its values along them, by Jacobi's method.
fn principal_axes(mut m: [[f64; 3]; 3]) -> ([[f64; 3]; 3], [f64; 3]) {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..ROUNDS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if m[p][q] == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * m[p][q]).atan2(m[p][p] - m[q][q]);
            let (sin, cos) = angle.sin_cos();
            let turned = |row: &mut [f64; 3]| {
                (row[p], row[q]) = (cos * row[p] + sin * row[q], cos * row[q] - sin * row[p])
            };
            m.iter_mut().for_each(turned);
            axes.iter_mut().for_each(turned);
            let rows = [m[p], m[q]];
            m[p] = [0, 1, 2].map(|k| cos * rows[0][k] + sin * rows[1][k]);
            m[q] = [0, 1, 2].map(|k| cos * rows[1][k] - sin * rows[0][k]);
        }
    }
    (axes, [0, 1, 2].map(|k| m[k][k]))
}
