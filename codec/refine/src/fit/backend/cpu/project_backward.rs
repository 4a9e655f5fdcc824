//! Stage `project_backward`: from the gradient by splats to that by parameters.
//!
//! Each Gaussian is projected once more and followed back, by itself.

use codec::sh_coefficients;
use rayon::prelude::*;

use super::project::{Projected, Projection, Splat, add, dot, matrix, scaled, transposed_times};
use super::rasterize_backward::SplatGradient;
use super::sh;
use crate::fit::backend::Gradient;
use crate::fit::parameters::Parameters;
use crate::fit::precision::Real;
use crate::fit::views::FrameView;

/// Gaussians that one thread follows in one go.
const CHUNK: usize = 256;

/// The gradient by the parameters of what was drawn.
pub(super) fn project_backward<T: Real>(
    splats: &[Splat<T>],
    d_splats: &[SplatGradient<T>],
    parameters: &Parameters<T>,
    view: &FrameView,
    detach_tau: bool,
) -> Gradient<T> {
    let projection = Projection::new(view);
    let mut by_row: Vec<(u32, u32)> = (0..).zip(splats).map(|(index, splat)| (splat.row, index)).collect();
    by_row.par_sort_unstable();
    let mut values = parameters.zeros(by_row.len());
    let mut screen = vec![T::zero(); by_row.len()];
    let write_chunk = |(mut rows, chunk): (Rows<T>, &[(u32, u32)])| {
        let mut non_finite = 0;
        for (place, (row, index)) in chunk.iter().enumerate() {
            let d_splat = &d_splats[*index as usize];
            let by_gaussian = gaussian(&projection, parameters, *row as usize, d_splat, detach_tau);
            let [x, y] = [0, 1].map(|axis| d_splat.center[axis] * projection.size[axis] * T::from_f64(0.5));
            let length = (x * x + y * y).sqrt();
            if by_gaussian.is_finite() && length.is_finite() {
                rows.write(place, &by_gaussian);
                rows.screen[place] = length;
            } else {
                non_finite += 1;
            }
        }
        non_finite
    };
    let chunks = Rows::chunks(&mut values, &mut screen).into_par_iter().zip(by_row.par_chunks(CHUNK));
    let non_finite = chunks.map(write_chunk).sum();
    Gradient { rows: by_row.into_iter().map(|(row, _)| row).collect(), values, screen, non_finite }
}

/// A part of the rows of a gradient, to be written to.
struct Rows<'a, T> {
    centers: &'a mut [[T; 3]],
    rotations: &'a mut [[T; 4]],
    log_scales: &'a mut [[T; 3]],
    logits: &'a mut [T],
    sh: &'a mut [[T; 3]],
    tau: &'a mut [T],
    log_widths: &'a mut [T],
    motion: &'a mut [[T; 3]],
    rotation_rates: &'a mut [[T; 4]],
    screen: &'a mut [T],
    coefficients: usize,
    motion_order: usize,
}

impl<'a, T: Real> Rows<'a, T> {
    /// [`CHUNK`] rows each, in their order.
    fn chunks(values: &'a mut Parameters<T>, screen: &'a mut [T]) -> Vec<Rows<'a, T>> {
        let count = values.len().div_ceil(CHUNK);
        let coefficients = sh_coefficients(values.sh_degree);
        let motion_order = usize::from(values.motion_order);
        let mut centers = values.centers.chunks_mut(CHUNK);
        let mut rotations = values.rotations.chunks_mut(CHUNK);
        let mut log_scales = values.log_scales.chunks_mut(CHUNK);
        let mut logits = values.logits.chunks_mut(CHUNK);
        let mut sh = values.sh.chunks_mut(CHUNK * coefficients);
        let mut tau = values.tau.chunks_mut(CHUNK);
        let mut log_widths = values.log_widths.chunks_mut(CHUNK);
        let mut motion = values.motion.chunks_mut(CHUNK * motion_order.max(1));
        let mut rotation_rates = values.rotation_rates.chunks_mut(CHUNK);
        let mut screen = screen.chunks_mut(CHUNK);
        // Empty columns have no chunks.
        let chunk = |_| Rows {
            centers: centers.next().unwrap_or_default(),
            rotations: rotations.next().unwrap_or_default(),
            log_scales: log_scales.next().unwrap_or_default(),
            logits: logits.next().unwrap_or_default(),
            sh: sh.next().unwrap_or_default(),
            tau: tau.next().unwrap_or_default(),
            log_widths: log_widths.next().unwrap_or_default(),
            motion: motion.next().unwrap_or_default(),
            rotation_rates: rotation_rates.next().unwrap_or_default(),
            screen: screen.next().unwrap_or_default(),
            coefficients,
            motion_order,
        };
        (0..count).map(chunk).collect()
    }

    fn write(&mut self, row: usize, gradient: &GaussianGradient<T>) {
        fn put<X: Copy>(column: &mut [X], row: usize, entries: &[X]) {
            if !column.is_empty() {
                column[row * entries.len()..][..entries.len()].copy_from_slice(entries);
            }
        }
        put(self.centers, row, &[gradient.center]);
        put(self.rotations, row, &[gradient.rotation]);
        put(self.log_scales, row, &[gradient.log_scale]);
        put(self.logits, row, &[gradient.logit]);
        put(self.sh, row, &gradient.sh[..self.coefficients]);
        put(self.tau, row, &[gradient.tau]);
        put(self.log_widths, row, &[gradient.log_width]);
        put(self.motion, row, &gradient.motion[..self.motion_order]);
        put(self.rotation_rates, row, &[gradient.rotation_rate]);
    }
}

/// The gradient by the parameters of one Gaussian; 0 in columns that are not there.
#[derive(Default)]
struct GaussianGradient<T> {
    center: [T; 3],
    rotation: [T; 4],
    log_scale: [T; 3],
    logit: T,
    sh: [[T; 3]; 16],
    tau: T,
    log_width: T,
    motion: [[T; 3]; 3],
    rotation_rate: [T; 4],
}

impl<T: Real> GaussianGradient<T> {
    fn is_finite(&self) -> bool {
        let quaternions = [self.rotation, self.rotation_rate];
        let columns = [
            self.sh.as_flattened(),
            self.motion.as_flattened(),
            quaternions.as_flattened(),
            &self.center,
            &self.log_scale,
            &[self.logit, self.tau, self.log_width],
        ];
        // 0 times a number is 0 where the number is finite, and NaN elsewhere.
        let sum = |column: &[T]| column.iter().fold(T::zero(), |sum, x| sum + *x * T::zero());
        columns.into_iter().all(|column| sum(column) == T::zero())
    }
}

/// Goes back through one Gaussian, which was drawn.
fn gaussian<T: Real>(
    projection: &Projection<T>,
    parameters: &Parameters<T>,
    row: usize,
    d_splat: &SplatGradient<T>,
    detach_tau: bool,
) -> GaussianGradient<T> {
    let mut out = GaussianGradient::default();
    let window = projection.window(parameters, row);
    let Some(projected) = window.and_then(|window| projection.project(parameters, row, window)) else {
        return out;
    };
    let (window, scales) = (projected.window, projected.scales);

    let (d_view, d_axes) = view_and_axes(projection, &projected, d_splat);
    let mut d_world = transposed_times(&projection.view_from_world, d_view);

    let count = sh_coefficients(parameters.sh_degree);
    let coefficients = &parameters.sh[row * count..(row + 1) * count];
    d_world = add(d_world, color(&projected, coefficients, d_splat.color, &mut out.sh[..count]));

    // In the world, the axes times the deviations are R S.
    let turned = matrix(projected.rotation);
    let m = &projection.view_from_world;
    let d_turned = [0, 1, 2].map(|r| {
        let by_world = [0, 1, 2]
            .map(|axis| m[0][r] * d_axes[0][axis] + m[1][r] * d_axes[1][axis] + m[2][r] * d_axes[2][axis]);
        [0, 1, 2].map(|axis| by_world[axis] * scales[axis])
    });
    out.log_scale =
        [0, 1, 2].map(|axis| (0..3).fold(T::zero(), |sum, r| sum + d_turned[r][axis] * turned[r][axis]));
    let d_rotation = quaternion(&projected, &d_turned);
    out.rotation = d_rotation;

    let d = window.since;
    out.center = d_world;
    let order = usize::from(parameters.motion_order);
    let (mut power, mut d_since) = (T::one(), T::zero());
    for (k, c) in parameters.motion[row * order..(row + 1) * order].iter().enumerate() {
        d_since += T::from_f64((k + 1) as f64) * power * dot(d_world, *c);
        power = power * d;
        out.motion[k] = scaled(d_world, power);
    }
    if let Some(rate) = parameters.rotation_rates.get(row) {
        out.rotation_rate = d_rotation.map(|x| x * d);
        (0..4).for_each(|k| d_since += d_rotation[k] * rate[k]);
    }

    // o = sigmoid(a) exp(-z^2 / 2), z = d / s.
    let by_log = d_splat.opacity * window.opacity;
    out.logit = by_log * window.clearness;
    if !parameters.tau.is_empty() {
        let z = window.since_in_widths;
        out.log_width = by_log * z * z;
        out.tau = by_log * z / window.width;
        if !detach_tau {
            out.tau -= d_since;
        }
    }
    out
}

/// From centre and footprint to the centre in the camera's axes, and to the Gaussian's axes times their
/// deviations there.
fn view_and_axes<T: Real>(
    projection: &Projection<T>,
    projected: &Projected<T>,
    d_splat: &SplatGradient<T>,
) -> ([T; 3], [[T; 3]; 3]) {
    let two = T::from_f64(2.0);
    let Splat { lean, precision, .. } = projected.splat;
    // The variance of x where y is known is xx - xy^2 / yy, and lean is xy / yy.
    let d_variance = -precision[0] * precision[0] * d_splat.precision[0];
    let d_lean = d_splat.lean / projected.variance_y;
    let d_xx = d_variance;
    let d_xy = d_lean - two * lean * d_variance;
    let d_yy = lean * lean * d_variance - lean * d_lean - precision[1] * precision[1] * d_splat.precision[1];

    let [x_image, y_image] = projected.images;
    let d_images = [
        add(scaled(x_image, two * d_xx), scaled(y_image, d_xy)),
        add(scaled(y_image, two * d_yy), scaled(x_image, d_xy)),
    ];
    let [x, y, z] = projected.view;
    let center = [x / z, y / z];
    let mut d_view = [T::zero(); 3];
    let mut d_axes = [[T::zero(); 3]; 3];
    for axis in 0..2 {
        let f = projection.focal[axis] / z;
        let slope = projected.slope[axis];
        d_axes[axis] = scaled(d_images[axis], f);
        d_axes[2] = add(d_axes[2], scaled(d_images[axis], -f * slope));
        // The image is proportional to f.
        d_view[2] -= dot(d_images[axis], projected.images[axis]) / z;
        let mut d_slope = d_splat.center[axis] * projection.focal[axis];
        if projected.is_inside[axis] {
            d_slope -= f * dot(d_images[axis], projected.axes[2]);
        }
        d_view[axis] = d_slope / z;
        d_view[2] -= d_slope * center[axis] / z;
    }
    (d_view, d_axes)
}

/// From a colour to its coefficients and, which is returned, to the position.
fn color<T: Real>(
    projected: &Projected<T>,
    coefficients: &[[T; 3]],
    d_color: [T; 3],
    out: &mut [[T; 3]],
) -> [T; 3] {
    // A channel cut off at 0 does not follow its coefficients.
    let d_color = [0, 1, 2]
        .map(|channel| if projected.splat.color[channel] > T::zero() { d_color[channel] } else { T::zero() });
    let direction = projected.direction;
    let basis = sh::basis(direction, out.len());
    for (out, y) in out.iter_mut().zip(basis) {
        *out = scaled(d_color, y);
    }
    if out.len() == 1 || projected.distance <= T::zero() {
        return [T::zero(); 3];
    }
    let mut weights = [T::zero(); 16];
    for (weight, c) in weights.iter_mut().zip(coefficients) {
        *weight = dot(*c, d_color);
    }
    let d_direction = sh::basis_backward(direction, &weights[..coefficients.len()]);
    let along = dot(d_direction, direction);
    add(d_direction, scaled(direction, -along)).map(|x| x / projected.distance)
}

/// From the rotation matrix to the quaternion before it is brought to length 1.
fn quaternion<T: Real>(projected: &Projected<T>, g: &[[T; 3]; 3]) -> [T; 4] {
    let q @ [w, x, y, z] = projected.rotation;
    let length = projected.length;
    if length <= T::zero() {
        return [T::zero(); 4];
    }
    let (two, four) = (T::from_f64(2.0), T::from_f64(4.0));
    // Off the diagonal, what the matrix and its transpose have in common, and what not.
    let (xy, xz, yz) = (g[0][1] + g[1][0], g[0][2] + g[2][0], g[1][2] + g[2][1]);
    let turn = [g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]];
    let by_unit = [
        two * (x * turn[0] + y * turn[1] + z * turn[2]),
        two * (y * xy + z * xz + w * turn[0]) - four * x * (g[1][1] + g[2][2]),
        two * (x * xy + z * yz + w * turn[1]) - four * y * (g[0][0] + g[2][2]),
        two * (x * xz + y * yz + w * turn[2]) - four * z * (g[0][0] + g[1][1]),
    ];
    let along = (0..4).fold(T::zero(), |sum, k| sum + by_unit[k] * q[k]);
    [0, 1, 2, 3].map(|k| (by_unit[k] - along * q[k]) / length)
}
