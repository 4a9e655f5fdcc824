//! Stage `project_backward`: backpropagates the gradient from splats to parameters, through the intermediate results
//! of the projection.

use codec::sh_coefficients;
use rayon::prelude::*;

use super::project::{CHUNK, GaussianTrace, Instant, Window};
use super::rasterize_backward::SplatGradient;
use crate::fit::backend::Gradient;
use crate::fit::cameras::ViewGradient;
use crate::fit::parameters::{COLUMNS, Parameters, row_of};
use crate::fit::views::FrameView;
use crate::raster::{
    Footprint, Projected, Projection, Real, Splat, add, basis, basis_backward, cross, dot, matrix, scaled,
    transposed_times,
};

/// The gradient with respect to the parameters of the rendered Gaussians, from the gradients of their splats. `traces` and
/// `places` are as in a [`ForwardPass`](super::ForwardPass).
pub(super) fn project_backward<T: Real>(
    traces: &[Vec<GaussianTrace<T>>],
    places: &[u32],
    d_splats: &[SplatGradient<T>],
    parameters: &Parameters<T>,
    view: &FrameView,
    detach_tau: bool,
) -> Gradient<T> {
    let Instant { projection, .. } = Instant::new(view, parameters);
    let mut values = parameters.zeros(d_splats.len());
    let mut screen = vec![T::zero(); d_splats.len()];
    let columns = values.parts_mut(traces.iter().map(Vec::len));
    let mut rest = &mut screen[..];
    let screens = traces.iter().map(|traces| rest.split_off_mut(..traces.len()).expect("a number for each"));
    let chunks =
        columns.into_par_iter().zip(screens.collect::<Vec<_>>()).zip(traces).zip(places.par_chunks(CHUNK));
    let write_chunks = chunks.map(|(((mut columns, screen), traces), places)| {
        let (mut non_finite, mut by_view) = (0, ByView::default());
        for (row, (trace, place)) in traces.iter().zip(places).enumerate() {
            let d_splat = &d_splats[*place as usize];
            let (gradient, by) = gaussian(&projection, parameters, trace, d_splat, detach_tau);
            let [x, y] = [0, 1].map(|axis| d_splat.center[axis] * projection.size[axis] * T::from_f64(0.5));
            let norm = (x * x + y * y).sqrt();
            if gradient.is_finite() && norm.is_finite() {
                gradient.write(&mut columns, traces.len(), row);
                screen[row] = norm;
                by_view.add(&by);
            } else {
                non_finite += 1;
            }
        }
        (non_finite, by_view)
    });
    let (mut non_finite, mut by_view) = (0, ByView::default());
    for (of_chunk, by) in write_chunks.collect::<Vec<_>>() {
        non_finite += of_chunk;
        by_view.add(&by);
    }
    let rows = traces.iter().flatten().map(|trace| trace.projected.splat.row).collect();
    Gradient { rows, values, screen, view: by_view.in_camera(&projection), non_finite }
}

/// Parts of a [`ViewGradient`], which are summed over the Gaussians.
#[derive(Clone, Copy, Default)]
struct ByView<T> {
    time: T,
    rotation: [T; 3],
    /// With respect to the centres, in world axes.
    center: [T; 3],
    log_focal: T,
}

impl<T: Real> ByView<T> {
    fn add(&mut self, other: &ByView<T>) {
        self.time += other.time;
        self.rotation = add(self.rotation, other.rotation);
        self.center = add(self.center, other.center);
        self.log_focal += other.log_focal;
    }

    /// A translation of what the camera sees is one of all centres: colours depend on the direction to the camera.
    fn in_camera(&self, projection: &Projection<T>) -> ViewGradient<T> {
        ViewGradient {
            time: self.time,
            rotation: self.rotation,
            translation: [0, 1, 2].map(|row| dot(projection.view_from_world[row], self.center)),
            log_focal: self.log_focal,
        }
    }
}

/// The gradient with respect to the parameters of one Gaussian; 0 in absent columns.
#[derive(Default)]
struct GaussianGradient<T> {
    center: [T; 3],
    rotation: [T; 4],
    log_scale: [T; 3],
    logit: [T; 1],
    sh: [[T; 3]; 16],
    tau: [T; 1],
    log_width: [T; 1],
    motion: [[T; 3]; 3],
    rotation_rate: [T; 4],
}

impl<T: Real> GaussianGradient<T> {
    /// In the order of [`Parameters::columns`].
    fn columns(&self) -> [&[T]; COLUMNS] {
        [
            &self.center,
            &self.rotation,
            &self.log_scale,
            &self.logit,
            self.sh.as_flattened(),
            &self.tau,
            &self.log_width,
            self.motion.as_flattened(),
            &self.rotation_rate,
        ]
    }

    /// Writes it to a row of the columns of `count` rows.
    fn write(&self, columns: &mut [&mut [T]; COLUMNS], count: usize, row: usize) {
        for (to, values) in row_of(columns, count, row).into_iter().zip(self.columns()) {
            to.copy_from_slice(&values[..to.len()]);
        }
    }

    fn is_finite(&self) -> bool {
        // 0 times x is 0 for a finite x, else NaN: a sum without branches.
        let sum = |column: &[T]| column.iter().fold(T::zero(), |sum, x| sum + *x * T::zero());
        self.columns().into_iter().all(|column| sum(column) == T::zero())
    }
}

/// Backpropagates through one rendered Gaussian.
fn gaussian<T: Real>(
    projection: &Projection<T>,
    parameters: &Parameters<T>,
    trace: &GaussianTrace<T>,
    d_splat: &SplatGradient<T>,
    detach_tau: bool,
) -> (GaussianGradient<T>, ByView<T>) {
    let mut out = GaussianGradient::default();
    let GaussianTrace { projected, window, .. } = trace;
    let row = projected.splat.row as usize;
    let (mut d_view, d_axes, log_focal) = view_and_axes(projection, projected, d_splat);
    let d_log_opacity = d_splat.opacity * projected.splat.opacity;
    d_view[2] += d_log_opacity * projection.log_fade_slope(projected.view[2]);
    let mut d_world = transposed_times(&projection.view_from_world, d_view);
    let count = sh_coefficients(parameters.sh_degree);
    let coefficients = &parameters.sh[row * count..(row + 1) * count];
    d_world = add(d_world, color(projected, coefficients, d_splat.color, &mut out.sh[..count]));
    orientation(projection, trace, &d_axes, &mut out);
    out.center = d_world;
    let d_since = motion(parameters, row, window.since, &mut out);
    let by_since = if detach_tau { T::zero() } else { d_since };
    let is_timed = !parameters.tau.is_empty();
    let fading = temporal(window, d_log_opacity, by_since, is_timed, &mut out);
    // What is turned about the camera's centre: the centre and the axes, in camera space.
    let mut rotation = cross(projected.view, d_view);
    for axis in 0..3 {
        let column = |rows: &[[T; 3]; 3]| [0, 1, 2].map(|row: usize| rows[row][axis]);
        rotation = add(rotation, cross(column(&projected.axes), column(&d_axes)));
    }
    (out, ByView { time: d_since - fading, rotation, center: d_world, log_focal })
}

/// From centre and footprint to the centre and the scaled axes in camera space, and to the logarithm of the focal
/// lengths.
fn view_and_axes<T: Real>(
    projection: &Projection<T>,
    projected: &Projected<T>,
    d_splat: &SplatGradient<T>,
) -> ([T; 3], [[T; 3]; 3], T) {
    let two = T::from_f64(2.0);
    let Splat { shear, inverse_variance, .. } = projected.splat;
    let footprint = &projected.footprint;
    // The variance of x given y is xx - xy^2 / yy, and shear is xy / yy.
    let d_variance = -inverse_variance[0] * inverse_variance[0] * d_splat.inverse_variance[0];
    let d_shear = d_splat.shear / projected.splat.covariance[2];
    let d_xx = d_variance;
    let d_xy = d_shear - two * shear * d_variance;
    let d_yy = shear * shear * d_variance
        - shear * d_shear
        - inverse_variance[1] * inverse_variance[1] * d_splat.inverse_variance[1];

    let [x_image, y_image] = footprint.images;
    let mut d_images = [
        add(scaled(x_image, two * d_xx), scaled(y_image, d_xy)),
        add(scaled(y_image, two * d_yy), scaled(x_image, d_xy)),
    ];
    if projection.filter.compensates() {
        let added = T::from_f64(projection.filter.variance());
        let d_compensation = compensation(projected, added, d_splat.opacity * projected.splat.opacity);
        d_images = [0, 1].map(|axis| add(d_images[axis], d_compensation[axis]));
    }
    let [x, y, z] = projected.view;
    let center = [x / z, y / z];
    let mut d_view = [T::zero(); 3];
    let mut d_axes = [[T::zero(); 3]; 3];
    let mut log_focal = T::zero();
    for axis in 0..2 {
        let f = projection.focal[axis] / z;
        // The centre and the image are proportional to it.
        log_focal += d_splat.center[axis] * projection.focal[axis] * center[axis]
            + dot(d_images[axis], footprint.images[axis]);
        d_axes[axis] = scaled(d_images[axis], f);
        d_axes[2] = add(d_axes[2], scaled(d_images[axis], -f * footprint.slope[axis]));
        // The image is proportional to f.
        d_view[2] -= dot(d_images[axis], footprint.images[axis]) / z;
        let mut d_slope = d_splat.center[axis] * projection.focal[axis];
        if footprint.is_inside[axis] {
            d_slope -= f * dot(d_images[axis], projected.axes[2]);
        }
        d_view[axis] = d_slope / z;
        d_view[2] -= d_slope * center[axis] / z;
    }
    (d_view, d_axes, log_focal)
}

/// From the logarithm of the factor of the opacity, `sqrt(A / D)`, to the images `x` and `y`, where `A` is
/// `|x x y|^2` and `D` is `A + b (|x|^2 + |y|^2) + b^2` for the variance `b` that the filter added.
fn compensation<T: Real>(projected: &Projected<T>, added: T, d_log_factor: T) -> [[T; 3]; 2] {
    let Footprint { images: [x, y], determinant, area, .. } = &projected.footprint;
    let [xx, _, yy] = projected.splat.covariance;
    // (1 / A - 1 / D) is b (|x|^2 + |y|^2 + b) / (A D), and half the derivatives of A are y x (x x y) and
    // (x x y) x x: neither cancels.
    let by_added = d_log_factor * added / *determinant;
    let by_area = by_added * (xx + yy - added) / dot(*area, *area);
    [
        add(scaled(cross(*y, *area), by_area), scaled(*x, -by_added)),
        add(scaled(cross(*area, *x), by_area), scaled(*y, -by_added)),
    ]
}

/// From a colour to its coefficients. Returns the gradient with respect to the position.
fn color<T: Real>(
    projected: &Projected<T>,
    coefficients: &[[T; 3]],
    d_color: [T; 3],
    out: &mut [[T; 3]],
) -> [T; 3] {
    // A clamped channel keeps only a gradient that leads back between 0 and 1: a colour that starts at white can darken.
    let d_color = [0, 1, 2].map(|channel| {
        let (color, d_color) = (projected.splat.color[channel], d_color[channel]);
        if color <= T::zero() {
            d_color.min(T::zero())
        } else if color >= T::one() {
            d_color.max(T::zero())
        } else {
            d_color
        }
    });
    let direction = projected.direction;
    let harmonics = basis(direction, out.len());
    for (out, y) in out.iter_mut().zip(harmonics) {
        *out = scaled(d_color, y);
    }
    if out.len() == 1 || projected.splat.distance <= T::zero() {
        return [T::zero(); 3];
    }
    let mut weights = [T::zero(); 16];
    for (weight, c) in weights.iter_mut().zip(coefficients) {
        *weight = dot(*c, d_color);
    }
    let d_direction = basis_backward(direction, &weights[..coefficients.len()]);
    let along = dot(d_direction, direction);
    add(d_direction, scaled(direction, -along)).map(|x| x / projected.splat.distance)
}

/// From the scaled axes, R S in the world, to scales and rotation.
fn orientation<T: Real>(
    projection: &Projection<T>,
    trace: &GaussianTrace<T>,
    d_axes: &[[T; 3]; 3],
    out: &mut GaussianGradient<T>,
) {
    let rotated = matrix(trace.rotation);
    let m = &projection.view_from_world;
    let d_rotated = [0, 1, 2].map(|r| {
        let d_world = [0, 1, 2]
            .map(|axis| m[0][r] * d_axes[0][axis] + m[1][r] * d_axes[1][axis] + m[2][r] * d_axes[2][axis]);
        [0, 1, 2].map(|axis| d_world[axis] * trace.scales[axis])
    });
    out.log_scale =
        [0, 1, 2].map(|axis| (0..3).fold(T::zero(), |sum, r| sum + d_rotated[r][axis] * rotated[r][axis]));
    out.rotation = quaternion(trace, &d_rotated);
}

/// From the rotation matrix to the quaternion before its normalisation.
fn quaternion<T: Real>(trace: &GaussianTrace<T>, g: &[[T; 3]; 3]) -> [T; 4] {
    let q @ [w, x, y, z] = trace.rotation;
    let length = trace.length;
    if length <= T::zero() {
        return [T::zero(); 4];
    }
    let (two, four) = (T::from_f64(2.0), T::from_f64(4.0));
    // The symmetric and the antisymmetric part off the diagonal.
    let (xy, xz, yz) = (g[0][1] + g[1][0], g[0][2] + g[2][0], g[1][2] + g[2][1]);
    let skew = [g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]];
    let by_unit = [
        two * (x * skew[0] + y * skew[1] + z * skew[2]),
        two * (y * xy + z * xz + w * skew[0]) - four * x * (g[1][1] + g[2][2]),
        two * (x * xy + z * yz + w * skew[1]) - four * y * (g[0][0] + g[2][2]),
        two * (x * xz + y * yz + w * skew[2]) - four * z * (g[0][0] + g[1][1]),
    ];
    let along = (0..4).fold(T::zero(), |sum, k| sum + by_unit[k] * q[k]);
    [0, 1, 2, 3].map(|k| (by_unit[k] - along * q[k]) / length)
}

/// From position and rotation at the frame, `d` intervals after `tau`, to motion and rotation rate. Returns
/// the derivative with respect to `d`.
fn motion<T: Real>(parameters: &Parameters<T>, row: usize, d: T, out: &mut GaussianGradient<T>) -> T {
    let order = usize::from(parameters.motion_order);
    let (mut power, mut d_since) = (T::one(), T::zero());
    for (k, c) in parameters.motion[row * order..(row + 1) * order].iter().enumerate() {
        d_since += T::from_f64((k + 1) as f64) * power * dot(out.center, *c);
        power = power * d;
        out.motion[k] = scaled(out.center, power);
    }
    if let Some(rate) = parameters.rotation_rates.get(row) {
        out.rotation_rate = out.rotation.map(|x| x * d);
        (0..4).for_each(|k| d_since += out.rotation[k] * rate[k]);
    }
    d_since
}

/// From the logarithm of the opacity at the frame, `o = sigmoid(a) exp(-z^2 / 2)` with `z = d / s`, and from `d` to
/// logit, width and `tau`. Returns the derivative of the fading with respect to `tau`.
fn temporal<T: Real>(
    window: &Window<T>,
    d_log_opacity: T,
    d_since: T,
    is_timed: bool,
    out: &mut GaussianGradient<T>,
) -> T {
    out.logit = [d_log_opacity * window.clearness];
    if !is_timed {
        return T::zero();
    }
    let z = window.since_in_widths;
    out.log_width = [d_log_opacity * z * z];
    let fading = d_log_opacity * z / window.width;
    out.tau = [fading - d_since];
    fading
}
