//! [`Eye`]: frustum culling for one eye.

use glam::{Affine3A, DMat4, DVec3, Vec2};

use super::columns::{BATCH, Places};
use crate::view::View;

/// A view prepared for culling: without divisions, in pixels from the principal point.
#[derive(Clone, Copy)]
pub(super) struct Eye {
    /// From world axes with the clip's origin as their origin.
    view_from_clip: Affine3A,
    focal: Vec2,
    /// Upper bound of the pixels that a unit of length covers at distance 1.
    magnification: Vec2,
    /// Least depth of what is drawn: the start of the fade near the eye.
    least_depth: f32,
    /// The image and a margin around it, in pixels.
    low: Vec2,
    high: Vec2,
}

impl Eye {
    pub(super) const NONE: Eye = Eye {
        view_from_clip: Affine3A::IDENTITY,
        focal: Vec2::ONE,
        magnification: Vec2::ZERO,
        least_depth: 0.0,
        low: Vec2::ZERO,
        high: Vec2::ZERO,
    };

    /// Prepares `view`; `origin` is the clip's origin in the world, `near` the clip's near distance.
    pub(super) fn new(view: &View, origin: DVec3, near: f32) -> Eye {
        // The radius to which a filter alone, of at most 0.3 px^2, can carry a Gaussian, plus a pixel for
        // rounding: sqrt(0.3 * 2 ln 255) + 1.
        const MARGIN: f32 = 2.9;
        let (low, high) = slope_limits(view);
        let slope = low.abs().max(high.abs());
        let view_from_clip = view.view_from_world * DMat4::from_translation(origin);
        Eye {
            view_from_clip: Affine3A::from_mat4(view_from_clip.as_mat4()),
            focal: view.focal,
            magnification: view.focal * (1.0 + slope * slope).powf(0.5),
            // The least opacity that is drawn has a margin of 0.002 near distances for rounding.
            least_depth: shaders::FADE_START * near,
            low: -view.principal - MARGIN,
            high: view.size.as_vec2() - view.principal + MARGIN,
        }
    }

    /// Frustum culling: sets `visible` for each of `places` that may overlap the image. Conservative: culled
    /// Gaussians never overlap it.
    pub(super) fn cull(&self, places: &Places, support_radius: &[f32], visible: &mut [u32; BATCH]) {
        let Affine3A { matrix3, translation } = self.view_from_clip;
        let ([a, b, c], o) = ([matrix3.x_axis, matrix3.y_axis, matrix3.z_axis], translation);
        let [xs, ys, zs] = places;
        for ((((x, y), z), support_radius), visible) in
            xs.iter().zip(ys).zip(zs).zip(support_radius).zip(visible)
        {
            // All terms are multiplied by the depth. The footprint's standard deviation is
            // sqrt(a^2 + b^2) with the filter b: at most a + b, and the margin includes b.
            let depth = a.z * x + b.z * y + c.z * z + o.z;
            let right = self.focal.x * (a.x * x + b.x * y + c.x * z + o.x);
            let down = self.focal.y * (a.y * x + b.y * y + c.y * z + o.y);
            let (wide, high) = (self.magnification.x * support_radius, self.magnification.y * support_radius);
            *visible |= u32::from(depth > 0.0)
                & u32::from(depth >= self.least_depth)
                & u32::from(right + wide >= self.low.x * depth)
                & u32::from(right - wide <= self.high.x * depth)
                & u32::from(down + high >= self.low.y * depth)
                & u32::from(down - high <= self.high.y * depth);
        }
    }
}

/// Range of x/z and y/z within which footprints are computed: the image, extended on every side by 30 % of
/// half the field of view.
pub(in crate::gpu) fn slope_limits(view: &View) -> (Vec2, Vec2) {
    let [low, high] = view.slopes;
    let margin = 0.3 * 0.5 * (high - low);
    (low - margin, high + margin)
}
