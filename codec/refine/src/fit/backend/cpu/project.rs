//! Stage `project`: evaluates Gaussians at the frame and projects them into the image.
//!
//! The footprint is the affine approximation of EWA splatting (Zwicker et al. 2001) in the form of gsplat,
//! as in the reference. It is kept as the variances of y and of x given y, so that needles lose no digits.

use codec::{ALPHA_MIN, FADE_START, PixelFilter, near_fade, sh_coefficients};
use rayon::prelude::*;

use super::sh;
use crate::fit::parameters::{NORM_MIN, Parameters};
use crate::fit::precision::Real;
use crate::fit::views::FrameView;

/// Squared time from the centre of a window, in widths, beyond which no Gaussian is visible: `e^(-x/2)` is below
/// [`ALPHA_MIN`].
const FADED: f64 = 11.1;

/// Rows per parallel task.
const CHUNK: usize = 256;

/// A Gaussian projected into the image. With `d` from its centre to a pixel's centre, the squared
/// Mahalanobis distance is `q = inverse_variance[0] (d.x - shear d.y)^2 + inverse_variance[1] d.y^2`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat<T> {
    /// Row of the parameters.
    pub(super) row: u32,
    /// Centre in pixels, from the image's top left corner.
    pub(super) center: [T; 2],
    /// Mean of `d.x` per unit of `d.y`.
    pub(super) shear: T,
    /// In px^-2: of x given y, and of y.
    pub(super) inverse_variance: [T; 2],
    /// Opacity at the frame, in `[ALPHA_MIN, 1]`, compensated if the filter compensates.
    pub(super) opacity: T,
    /// Red, green, blue towards the camera, at least 0.
    pub(super) color: [T; 3],
    /// Distance of the centre along the camera's axis.
    pub(super) depth: T,
    /// `q` above which alpha is certainly below [`ALPHA_MIN`].
    pub(super) q_max: T,
    /// Half the size of the bounding box of the ellipse `q = q_max`.
    pub(super) half_extent: [T; 2],
    /// `d.y` at which the ellipse touches its bounding box on the right; on the left it is `-tangent_y`.
    pub(super) tangent_y: T,
}

/// A projected Gaussian with the intermediate results that its gradient needs.
#[derive(Clone, Debug)]
pub(super) struct Projected<T> {
    pub(super) splat: Splat<T>,
    pub(super) window: Window<T>,
    /// Unit vector from the camera to the centre (0 if they coincide), and the distance.
    pub(super) direction: [T; 3],
    pub(super) distance: T,
    /// Unit quaternion, and its length before normalisation; 0 if that is too short.
    pub(super) rotation: [T; 4],
    pub(super) length: T,
    pub(super) scales: [T; 3],
    /// Centre in camera space.
    pub(super) view: [T; 3],
    /// Columns are the Gaussian's axes times their standard deviations, in camera space.
    pub(super) axes: [[T; 3]; 3],
    pub(super) footprint: Footprint<T>,
}

/// The temporal window of a Gaussian at the frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window<T> {
    /// Opacity at the frame, faded near the camera, not compensated.
    pub(super) opacity: T,
    /// 1 minus the peak opacity.
    pub(super) clearness: T,
    /// Time since `tau` in intervals; 0 without time.
    pub(super) since: T,
    /// The same in window widths.
    pub(super) since_in_widths: T,
    /// Width in intervals; 1 without time.
    pub(super) width: T,
}

/// The affine approximation of a Gaussian in the image.
#[derive(Clone, Debug)]
pub(super) struct Footprint<T> {
    /// x/z and y/z at which the Jacobian is evaluated, and whether those are the centre's.
    pub(super) slope: [T; 2],
    pub(super) is_inside: [bool; 2],
    /// Rows are the images of the scaled axes in x and in y, in pixels.
    pub(super) images: [[T; 3]; 2],
    /// Variances of x and y in px^2, filter included.
    pub(super) variance: [T; 2],
    covariance: T,
    pub(super) determinant: T,
    /// Cross product of the images, whose square is the determinant without filter.
    pub(super) area: [T; 3],
}

/// A view in the precision of the projection, and the filter of the field.
pub(super) struct Projection<T> {
    pub(super) filter: PixelFilter,
    near: f64,
    time: T,
    pub(super) size: [T; 2],
    pub(super) focal: [T; 2],
    principal: [T; 2],
    /// Lowest and highest x/z and y/z at which the Jacobian is evaluated.
    limits: [[T; 2]; 2],
    pub(super) view_from_world: [[T; 3]; 3],
    translation: [T; 3],
    eye: [T; 3],
}

impl<T: Real> Projection<T> {
    pub(super) fn new(view: &FrameView, parameters: &Parameters<T>) -> Projection<T> {
        let camera = view.camera;
        let m = &camera.camera_from_world;
        Projection {
            filter: parameters.filter,
            near: parameters.near,
            time: T::from_f64(view.time),
            size: [camera.width, camera.height].map(|side| T::from_f64(f64::from(side))),
            focal: [camera.k[0][0], camera.k[1][1]].map(T::from_f64),
            principal: [camera.k[0][2], camera.k[1][2]].map(T::from_f64),
            limits: view.slope_limits().map(|limits| limits.map(T::from_f64)),
            view_from_world: [0, 1, 2].map(|r| [0, 1, 2].map(|c| T::from_f64(m[r][c]))),
            translation: [0, 1, 2].map(|r| T::from_f64(m[r][3])),
            eye: camera.position().map(T::from_f64),
        }
    }

    /// The Gaussians that reach a pixel, in the order of their rows.
    pub(super) fn all(&self, parameters: &Parameters<T>) -> Vec<Projected<T>> {
        let chunks = (0..parameters.len().div_ceil(CHUNK)).into_par_iter();
        let project = |chunk: usize| {
            let rows = chunk * CHUNK..parameters.len().min((chunk + 1) * CHUNK);
            let mut projected = Vec::with_capacity(rows.len());
            projected
                .extend(rows.filter_map(|row| self.project(parameters, row, self.window(parameters, row)?)));
            projected
        };
        chunks.map(project).collect::<Vec<_>>().into_iter().flatten().collect()
    }

    /// The window of a Gaussian; `None` if it is invisible at the frame.
    pub(super) fn window(&self, parameters: &Parameters<T>, row: usize) -> Option<Window<T>> {
        let one = T::one();
        let (since, width) = match parameters.tau.get(row) {
            Some(tau) => (self.time - *tau, parameters.log_widths[row].exp()),
            None => (T::zero(), one),
        };
        let since_in_widths = since / width;
        // Most Gaussians of a long clip end here: the fading alone makes them invisible.
        if since_in_widths * since_in_widths > T::from_f64(FADED) {
            return None;
        }
        let fading = (-T::from_f64(0.5) * since_in_widths * since_in_widths).exp();
        let logit = parameters.logits[row];
        let opacity = fading / (one + (-logit).exp());
        let clearness = one / (one + logit.exp());
        let is_visible = opacity >= T::from_f64(ALPHA_MIN);
        is_visible.then_some(Window { opacity, clearness, since, since_in_widths, width })
    }

    /// Projects a visible Gaussian; `None` if it reaches no pixel: it is faded near the camera, outside the
    /// image, or not finite.
    pub(super) fn project(
        &self,
        parameters: &Parameters<T>,
        row: usize,
        window: Window<T>,
    ) -> Option<Projected<T>> {
        let world = position(parameters, row, window.since);
        let view = add(times(&self.view_from_world, world), self.translation);
        let fade = T::from_f64(near_fade(view[2].to_double(), self.near));
        let window = Window { opacity: window.opacity * fade, ..window };
        // NaN fails this test, too.
        if !(window.opacity >= T::from_f64(ALPHA_MIN) && view[2].is_finite()) {
            return None;
        }
        let (rotation, length) = rotation(parameters, row, window.since)?;
        let scales = parameters.log_scales[row].map(T::exp);
        let in_world =
            matrix(rotation).map(|row| [row[0] * scales[0], row[1] * scales[1], row[2] * scales[2]]);
        let axes = [0, 1, 2].map(|r| transposed_times(&in_world, self.view_from_world[r]));
        let footprint = self.footprint(view, &axes);

        let gaze = add(world, scaled(self.eye, -T::one()));
        let distance = dot(gaze, gaze).sqrt();
        let direction = if distance > T::zero() { gaze.map(|x| x / distance) } else { [T::zero(); 3] };
        let color = color(parameters, row, direction);
        if !(color.iter().all(|x| x.is_finite()) && distance.is_finite()) {
            return None;
        }
        let color = color.map(|c| c.max(T::zero()));
        let splat = self.splat(row as u32, view, &footprint, window.opacity, color)?;
        Some(Projected {
            splat,
            window,
            direction,
            distance,
            rotation,
            length,
            scales,
            view,
            axes,
            footprint,
        })
    }

    /// Derivative of the logarithm of the fade at a depth.
    pub(super) fn log_fade_slope(&self, depth: T) -> T {
        match depth.to_double() < self.near {
            true => T::one() / (depth - T::from_f64(FADE_START * self.near)),
            false => T::zero(),
        }
    }

    /// The footprint of scaled axes at `view`.
    fn footprint(&self, view: [T; 3], axes: &[[T; 3]; 3]) -> Footprint<T> {
        let [x, y, z] = view;
        let [low, high] = self.limits;
        let at_center = [x / z, y / z];
        let slope = [0, 1].map(|axis| at_center[axis].max(low[axis]).min(high[axis]));
        // Rows of the Jacobian times the axes.
        let images =
            [0, 1].map(|axis| scaled(add(axes[axis], scaled(axes[2], -slope[axis])), self.focal[axis] / z));
        let added = T::from_f64(self.filter.variance());
        let [x_image, y_image] = images;
        let (xx, yy) = (dot(x_image, x_image), dot(y_image, y_image));
        // |a|^2 |b|^2 - (a . b)^2 is |a x b|^2, which does not cancel.
        let area = cross(x_image, y_image);
        Footprint {
            slope,
            is_inside: [0, 1].map(|axis| at_center[axis] == slope[axis]),
            images,
            variance: [xx + added, yy + added],
            covariance: dot(x_image, y_image),
            determinant: dot(area, area) + added * (xx + yy) + added * added,
            area,
        }
    }

    /// Factor of the opacity of a footprint, 0 to 1: the root of the ratio of the determinants without and with
    /// the filter if that compensates, else 1.
    fn compensation(&self, footprint: &Footprint<T>) -> T {
        match self.filter.compensates() {
            true => (dot(footprint.area, footprint.area) / footprint.determinant).sqrt(),
            false => T::one(),
        }
    }

    /// The splat of a footprint; `None` if it is not finite, outside the image, or compensated to nothing.
    fn splat(
        &self,
        row: u32,
        view: [T; 3],
        footprint: &Footprint<T>,
        opacity: T,
        color: [T; 3],
    ) -> Option<Splat<T>> {
        let z = view[2];
        let center = [0, 1].map(|axis| self.focal[axis] / z * view[axis] + self.principal[axis]);
        let &Footprint { variance: [xx, yy], covariance: xy, determinant, .. } = footprint;
        if !(center.iter().all(|x| x.is_finite()) && determinant.is_finite()) {
            return None;
        }
        let opacity = opacity * self.compensation(footprint);
        // NaN is invisible, too.
        let is_visible = opacity >= T::from_f64(ALPHA_MIN);
        if self.filter.compensates() && !is_visible {
            return None;
        }
        let visible = T::from_f64(2.0 * libm::log(opacity.to_double() / ALPHA_MIN)).max(T::zero());
        // The margin exceeds the rounding error of the exponential.
        let q_max = visible + T::from_f64(256.0) * T::epsilon();
        let half_extent = [(q_max * xx).sqrt(), (q_max * yy).sqrt()];
        let is_in_image = [0, 1].map(|axis| {
            center[axis] + half_extent[axis] > T::zero() && center[axis] - half_extent[axis] < self.size[axis]
        });
        (is_in_image == [true, true]).then(|| Splat {
            row,
            center,
            shear: xy / yy,
            inverse_variance: [yy / determinant, T::one() / yy],
            opacity,
            color,
            depth: z,
            q_max,
            half_extent,
            tangent_y: half_extent[0] * (xy / xx),
        })
    }
}

/// The paper's trajectory: `mu + c1 d + c2 d^2 + c3 d^3`.
fn position<T: Real>(parameters: &Parameters<T>, row: usize, d: T) -> [T; 3] {
    let order = usize::from(parameters.motion_order);
    let mut offset = [T::zero(); 3];
    for c in parameters.motion[row * order..(row + 1) * order].iter().rev() {
        offset = scaled(add(offset, *c), d);
    }
    add(parameters.centers[row], offset)
}

/// Unit quaternion `d` frames after `tau`, and its length before normalisation; the identity and 0 if it
/// is too short. `None` if it is not finite.
fn rotation<T: Real>(parameters: &Parameters<T>, row: usize, d: T) -> Option<([T; 4], T)> {
    let mut q = parameters.rotations[row];
    if let Some(rate) = parameters.rotation_rates.get(row) {
        (0..4).for_each(|k| q[k] += rate[k] * d);
    }
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    if length > T::from_f64(NORM_MIN) {
        return length.is_finite().then(|| (q.map(|x| x / length), length));
    }
    let zero = T::zero();
    (!length.is_nan()).then_some(([T::one(), zero, zero, zero], zero))
}

/// Rotation matrix, row by row, of a unit quaternion w, x, y, z.
pub(super) fn matrix<T: Real>([w, x, y, z]: [T; 4]) -> [[T; 3]; 3] {
    let (one, two) = (T::one(), T::from_f64(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

/// `0.5 + sum(Y_k c_k)` per channel; a splat has the positive part.
fn color<T: Real>(parameters: &Parameters<T>, row: usize, direction: [T; 3]) -> [T; 3] {
    let count = sh_coefficients(parameters.sh_degree);
    let basis = sh::basis(direction, count);
    let mut color = [T::from_f64(0.5); 3];
    for (y, c) in basis.iter().zip(&parameters.sh[row * count..(row + 1) * count]) {
        color = add(color, scaled(*c, *y));
    }
    color
}

pub(super) fn add<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn scaled<T: Real>(a: [T; 3], scale: T) -> [T; 3] {
    a.map(|x| x * scale)
}

pub(super) fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Matrix times vector, `m v`.
pub(super) fn times<T: Real>(m: &[[T; 3]; 3], v: [T; 3]) -> [T; 3] {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// Transposed matrix times vector, `m^T v`.
pub(super) fn transposed_times<T: Real>(m: &[[T; 3]; 3], v: [T; 3]) -> [T; 3] {
    add(add(scaled(m[0], v[0]), scaled(m[1], v[1])), scaled(m[2], v[2]))
}
