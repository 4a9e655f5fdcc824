//! Stage `project`: moves Gaussians to the instant and projects them into the image.
//!
//! The footprint is the affine approximation of EWA splatting (Zwicker et al. 2001) in the form of
//! gsplat, as in the reference. It is kept as what `y` has and what `x` has once `y` is known, so that
//! needles lose no digits.

use codec::{ALPHA_MIN, sh_coefficients};
use rayon::prelude::*;

use super::sh;
use crate::fit::parameters::{NORM_MIN, Parameters};
use crate::fit::precision::Real;
use crate::fit::views::FrameView;

/// Added to the variances of every footprint, in px^2: a splat never falls between pixels.
pub(in crate::fit) const BLUR: f64 = 0.3;

/// Distance in front of the camera, in units of the capture, from which Gaussians are drawn.
pub(in crate::fit) const NEAR: f64 = 0.01;

/// A Gaussian as the rasteriser sees it. With `d` from its centre to a pixel's, the squared distance in
/// standard deviations is `q = precision[0] (d.x - lean d.y)^2 + precision[1] d.y^2`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat<T> {
    /// Row of the parameters.
    pub(super) row: u32,
    /// Centre in pixels, from the image's top left corner.
    pub(super) center: [T; 2],
    /// How far the ellipse's middle moves in x per step in y.
    pub(super) lean: T,
    /// Inverse variances in px^-2: of x where y is known, and of y.
    pub(super) precision: [T; 2],
    /// Opacity at the instant, in `[ALPHA_MIN, 1]`.
    pub(super) opacity: T,
    /// Red, green, blue towards the eye, from 0 up.
    pub(super) color: [T; 3],
    /// Distance of the centre along the camera's axis.
    pub(super) depth: T,
    /// `q` from which alpha is certainly below [`ALPHA_MIN`].
    pub(super) far: T,
    /// Half the size of the box around the ellipse `q = far`.
    pub(super) reach: [T; 2],
    /// `d.y` where the ellipse touches its box on the right; the negative of it on the left.
    pub(super) touch: T,
}

/// A Gaussian at the instant, with what its derivatives need.
pub(super) struct Projected<T> {
    pub(super) splat: Splat<T>,
    pub(super) window: Window<T>,
    /// Unit vector from the eye to the centre (0 where they are one), and the distance.
    pub(super) direction: [T; 3],
    pub(super) distance: T,
    /// Unit quaternion, and the length it had; the length is 0 where the quaternion was too short to
    /// have a direction.
    pub(super) rotation: [T; 4],
    pub(super) length: T,
    pub(super) scales: [T; 3],
    /// Centre in the camera's axes.
    pub(super) view: [T; 3],
    /// x/z and y/z at which the Jacobian is taken, and whether that is at the centre.
    pub(super) slope: [T; 2],
    pub(super) is_inside: [bool; 2],
    /// Columns are the Gaussian's axes times their standard deviations, in the camera's axes.
    pub(super) axes: [[T; 3]; 3],
    /// Rows are the images of these axes in x and in y, in pixels.
    pub(super) images: [[T; 3]; 2],
    /// Variance of y, blur included.
    pub(super) variance_y: T,
}

/// The window of a Gaussian at the instant.
#[derive(Clone, Copy)]
pub(super) struct Window<T> {
    /// Opacity at the instant, and how much the peak opacity lacks to 1.
    pub(super) opacity: T,
    pub(super) clearness: T,
    /// Frames since `tau`, also in widths of the window; 0 without time.
    pub(super) since: T,
    pub(super) since_in_widths: T,
    /// Width in frames; 1 without time.
    pub(super) width: T,
}

/// A view in the form the projection needs.
pub(super) struct Projection<T> {
    frame: T,
    pub(super) size: [T; 2],
    pub(super) focal: [T; 2],
    principal: [T; 2],
    /// Lowest and highest x/z and y/z at which the Jacobian is taken.
    limits: [[T; 2]; 2],
    pub(super) view_from_world: [[T; 3]; 3],
    translation: [T; 3],
    eye: [T; 3],
}

impl<T: Real> Projection<T> {
    pub(super) fn new(view: &FrameView) -> Projection<T> {
        let camera = view.camera;
        let focal = [camera.k[0][0], camera.k[1][1]];
        let principal = [camera.k[0][2], camera.k[1][2]];
        let size = [f64::from(camera.width), f64::from(camera.height)];
        let m = &camera.camera_from_world;
        Projection {
            frame: T::from_f64(view.frame),
            size: size.map(T::from_f64),
            focal: focal.map(T::from_f64),
            principal: principal.map(T::from_f64),
            limits: view.slope_limits().map(|limits| limits.map(T::from_f64)),
            view_from_world: [0, 1, 2].map(|r| [0, 1, 2].map(|c| T::from_f64(m[r][c]))),
            translation: [0, 1, 2].map(|r| T::from_f64(m[r][3])),
            eye: camera.position().map(T::from_f64),
        }
    }

    /// The splats that can reach a pixel, in the order of their rows. Left out: what is not there at
    /// the instant, what is nearer than 0.01 units, and what has no finite footprint.
    pub(super) fn splats(&self, parameters: &Parameters<T>) -> Vec<Splat<T>> {
        let splat = |row| Some(self.project(parameters, row, self.window(parameters, row)?)?.splat);
        (0..parameters.len()).into_par_iter().with_min_len(256).filter_map(splat).collect()
    }

    /// The window of a Gaussian that is visible at the instant.
    pub(super) fn window(&self, parameters: &Parameters<T>, row: usize) -> Option<Window<T>> {
        let one = T::one();
        let (since, width) = match parameters.tau.get(row) {
            Some(tau) => (self.frame - *tau, parameters.log_widths[row].exp()),
            None => (T::zero(), one),
        };
        let since_in_widths = since / width;
        let fading = (-T::from_f64(0.5) * since_in_widths * since_in_widths).exp();
        let logit = parameters.logits[row];
        let opacity = fading / (one + (-logit).exp());
        let clearness = one / (one + logit.exp());
        let is_visible = opacity >= T::from_f64(ALPHA_MIN);
        is_visible.then_some(Window { opacity, clearness, since, since_in_widths, width })
    }

    /// A visible Gaussian in the image, if it can reach a pixel there.
    pub(super) fn project(
        &self,
        parameters: &Parameters<T>,
        row: usize,
        window: Window<T>,
    ) -> Option<Projected<T>> {
        let world = position(parameters, row, window.since);
        let view = add(times(&self.view_from_world, world), self.translation);
        let [x, y, z] = view;
        // Also where it is NaN.
        if !(z >= T::from_f64(NEAR) && z.is_finite()) {
            return None;
        }
        let f = self.focal.map(|f| f / z);
        let center = [f[0] * x + self.principal[0], f[1] * y + self.principal[1]];

        let (rotation, length) = rotation(parameters, row, window.since)?;
        let scales = parameters.log_scales[row].map(T::exp);
        let turned = matrix(rotation);
        let in_world = turned.map(|row| [row[0] * scales[0], row[1] * scales[1], row[2] * scales[2]]);
        let axes = [0, 1, 2].map(|r| transposed_times(&in_world, self.view_from_world[r]));
        let [low, high] = self.limits;
        let at_center = [x / z, y / z];
        let slope = [0, 1].map(|axis| at_center[axis].max(low[axis]).min(high[axis]));
        let is_inside = [0, 1].map(|axis| at_center[axis] == slope[axis]);
        // Rows of the Jacobian times the axes.
        let images = [0, 1].map(|axis| scaled(add(axes[axis], scaled(axes[2], -slope[axis])), f[axis]));
        let blur = T::from_f64(BLUR);
        let [x_image, y_image] = images;
        let (xx, xy, yy) = (dot(x_image, x_image), dot(x_image, y_image), dot(y_image, y_image));
        // |a|^2 |b|^2 - (a . b)^2 is |a x b|^2, which does not cancel.
        let area = cross(x_image, y_image);
        let determinant = dot(area, area) + blur * (xx + yy) + blur * blur;
        let (xx, yy) = (xx + blur, yy + blur);

        let gaze = add(world, scaled(self.eye, -T::one()));
        let distance = dot(gaze, gaze).sqrt();
        let direction = if distance > T::zero() { gaze.map(|x| x / distance) } else { [T::zero(); 3] };
        let color = color(parameters, row, direction);

        let is_finite = center.iter().chain(&color).all(|x| x.is_finite())
            && distance.is_finite()
            && determinant.is_finite();
        if !is_finite {
            return None;
        }
        // A margin above the rounding of the exponential.
        let radius_squared =
            T::from_f64(2.0 * libm::log(window.opacity.to_double() / ALPHA_MIN)).max(T::zero());
        let far = radius_squared + T::from_f64(256.0) * T::epsilon();
        let reach = [(far * xx).sqrt(), (far * yy).sqrt()];
        let is_valid = [0, 1].map(|axis| {
            center[axis] + reach[axis] > T::zero() && center[axis] - reach[axis] < self.size[axis]
        });
        if is_valid != [true, true] {
            return None;
        }
        let splat = Splat {
            row: row as u32,
            center,
            lean: xy / yy,
            precision: [yy / determinant, T::one() / yy],
            opacity: window.opacity,
            color: color.map(|c| c.max(T::zero())),
            depth: z,
            far,
            reach,
            touch: reach[0] * (xy / xx),
        };
        let variance_y = yy;
        Some(Projected {
            splat,
            window,
            direction,
            distance,
            rotation,
            length,
            scales,
            view,
            slope,
            is_inside,
            axes,
            images,
            variance_y,
        })
    }
}

/// `mu + c1 d + c2 d^2 + c3 d^3`, the paper's trajectory.
fn position<T: Real>(parameters: &Parameters<T>, row: usize, d: T) -> [T; 3] {
    let order = usize::from(parameters.motion_order);
    let mut offset = [T::zero(); 3];
    for c in parameters.motion[row * order..(row + 1) * order].iter().rev() {
        offset = scaled(add(offset, *c), d);
    }
    add(parameters.centers[row], offset)
}

/// The unit quaternion at the instant and the length it had before; 1, 0, 0, 0 and length 0 where a
/// quaternion is too short. `None` where it is not finite.
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

/// The rotation matrix, row by row, of a unit quaternion w, x, y, z.
pub(super) fn matrix<T: Real>([w, x, y, z]: [T; 4]) -> [[T; 3]; 3] {
    let (one, two) = (T::one(), T::from_f64(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

/// `0.5 + sum(Y_k c_k)` per channel; a splat's colour is that where it is positive.
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

fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `m v`.
pub(super) fn times<T: Real>(m: &[[T; 3]; 3], v: [T; 3]) -> [T; 3] {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// `m^T v`.
pub(super) fn transposed_times<T: Real>(m: &[[T; 3]; 3], v: [T; 3]) -> [T; 3] {
    add(add(scaled(m[0], v[0]), scaled(m[1], v[1])), scaled(m[2], v[2]))
}
