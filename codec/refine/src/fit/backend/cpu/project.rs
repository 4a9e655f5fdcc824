//! Stage `project`: evaluates Gaussians at the frame and projects them into the image.

use codec::{ALPHA_MIN, sh_coefficients};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::fit::parameters::{NORM_MIN, Parameters};
use crate::fit::views::FrameView;
use crate::raster::{Projected, Projection, Real, add, scaled};

/// Squared time from the centre of a window, in widths, beyond which no Gaussian is visible: `e^(-x/2)` is below
/// [`ALPHA_MIN`].
const FADED: f64 = 11.1;

/// Rows per parallel task.
pub(super) const CHUNK: usize = 256;

/// A projected Gaussian with the intermediate results that its gradient needs.
#[derive(Clone, Debug)]
pub(super) struct GaussianTrace<T> {
    pub(super) projected: Projected<T>,
    pub(super) window: Window<T>,
    /// Unit quaternion, and its length before normalisation; 0 if that is too short.
    pub(super) rotation: [T; 4],
    pub(super) length: T,
    pub(super) scales: [T; 3],
}

/// The temporal window of a Gaussian at the frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window<T> {
    /// Opacity at the frame, neither faded near the camera nor compensated.
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

/// A view of a fit: what the camera sees of the field at the frame.
pub(super) struct Instant<T> {
    pub(super) projection: Projection<T>,
    time: T,
}

impl<T: Real> Instant<T> {
    pub(super) fn new(view: &FrameView, parameters: &Parameters<T>) -> Instant<T> {
        let projection = Projection::new(view.camera, parameters.filter, parameters.near);
        Instant { projection, time: T::from_f64(view.time) }
    }

    /// The Gaussians that reach a pixel, in the order of their rows: a list for each [`CHUNK`] of rows.
    pub(super) fn project_all(&self, arch: Arch, parameters: &Parameters<T>) -> Vec<Vec<GaussianTrace<T>>> {
        let project = |chunk: usize| {
            let first = chunk * CHUNK;
            let rows = first..parameters.len().min(first + CHUNK);
            let faded = match parameters.tau.is_empty() {
                true => [false; CHUNK],
                false => {
                    let (tau, log_widths) =
                        (&parameters.tau[rows.clone()], &parameters.log_widths[rows.clone()]);
                    arch.dispatch(Faded { time: self.time, tau, log_widths })
                }
            };
            let mut traces = Vec::new();
            for row in rows.filter(|row| !faded[row - first]) {
                let window = self.window(parameters, row);
                traces.extend(window.and_then(|window| self.project(parameters, row, window)));
            }
            traces
        };
        (0..parameters.len().div_ceil(CHUNK)).into_par_iter().map(project).collect()
    }

    /// The window of a Gaussian; `None` if it is invisible at the frame.
    pub(super) fn window(&self, parameters: &Parameters<T>, row: usize) -> Option<Window<T>> {
        let one = T::one();
        let (since, width) = match parameters.tau.get(row) {
            Some(tau) => (self.time - *tau, parameters.log_widths[row].exp()),
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

    /// Projects a visible Gaussian; `None` if it reaches no pixel: it is faded near the camera, outside the
    /// image, or not finite.
    pub(super) fn project(
        &self,
        parameters: &Parameters<T>,
        row: usize,
        window: Window<T>,
    ) -> Option<GaussianTrace<T>> {
        let center = self.projection.center(position(parameters, row, window.since), window.opacity)?;
        let [a, b, c] = parameters.log_scales[row];
        if !self.projection.may_reach(&center, a.max(b).max(c).exp()) {
            return None;
        }
        let (rotation, length) = rotation(parameters, row, window.since)?;
        let scales = [a, b, c].map(T::exp);
        let count = sh_coefficients(parameters.sh_degree);
        let coefficients = &parameters.sh[row * count..(row + 1) * count];
        let projected = self.projection.project(row as u32, center, rotation, scales, coefficients)?;
        let is_in_image = self.projection.is_in_image(&projected.splat);
        is_in_image.then_some(GaussianTrace { projected, window, rotation, length, scales })
    }
}

/// Finds the Gaussians, at most a [`CHUNK`], that their fading alone makes invisible: most of a long clip.
struct Faded<'a, T> {
    time: T,
    tau: &'a [T],
    log_widths: &'a [T],
}

impl<T: Real> NullaryFnOnce for Faded<'_, T> {
    type Output = [bool; CHUNK];

    #[inline(always)]
    fn call(self) -> [bool; CHUNK] {
        let mut faded = [false; CHUNK];
        let windows = self.tau.iter().zip(self.log_widths);
        for (faded, (tau, log_width)) in faded.iter_mut().zip(windows) {
            let since_in_widths = (self.time - *tau) / log_width.exp();
            *faded = since_in_widths * since_in_widths > T::from_f64(FADED);
        }
        faded
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
