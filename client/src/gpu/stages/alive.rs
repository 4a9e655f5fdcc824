//! Stage `alive`: which Gaussians can be seen at an instant, and how far away they are.
//!
//! The time index gives the candidates; those whose temporal opacity reaches 1/255 are alive; of
//! these, those that can reach into an image, and are not too faint to matter, are handed to the
//! stage `sort`.

use codec::{ALPHA_MIN, Field, LayerEnd, TimeIndex};
use glam::{DMat4, DVec3, Vec2, Vec3};

use super::sort::Item;
use crate::gpu::settings::{Settings, SortOrder};
use crate::view::{MiddleEye, View};

/// What the CPU keeps of a clip: the columns of the two equations, and how far Gaussians reach.
pub(in crate::gpu) struct Rows {
    still: Region,
    moving: Region,
    layers: Vec<LayerEnd>,
    time_index: TimeIndex,
}

struct Region {
    /// Centres, opacities and temporal columns only.
    field: Field,
    /// Distance from the centre, in units of the field, beyond which alpha stays below 1/255.
    reach: Vec<f32>,
    /// Standard deviations along the two longest axes, the longest first, in units of the field.
    sigmas: Vec<Vec2>,
}

/// What of a part of a clip can be seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gpu) struct Seen {
    /// Rows that are alive.
    pub(in crate::gpu) alive: u32,
    /// Those of them that are in sight and were left out all the same, see [`Settings::least_px`].
    pub(in crate::gpu) faint: u32,
}

impl Region {
    fn new(field: &Field) -> Region {
        let sigmas = |row: usize| {
            let mut scales = field.log_scales[row];
            scales.sort_by(f32::total_cmp);
            Vec2::new(scales[2].exp(), scales[1].exp())
        };
        let sigmas: Vec<Vec2> = (0..field.len()).map(sigmas).collect();
        let reach = |row: usize| {
            let radius = (2.0 * (f64::from(field.opacities[row]) / ALPHA_MIN).ln()).max(0.0).sqrt();
            sigmas[row].x * radius as f32
        };
        Region {
            field: Field {
                centers: field.centers.clone(),
                opacities: field.opacities.clone(),
                temporal: field.temporal.clone(),
                ..Field::default()
            },
            reach: (0..field.len()).map(reach).collect(),
            sigmas,
        }
    }
}

impl Rows {
    pub(in crate::gpu) fn new(
        still: &Field,
        moving: &Field,
        layers: Vec<LayerEnd>,
        time_index: TimeIndex,
    ) -> Rows {
        Rows { still: Region::new(still), moving: Region::new(moving), layers, time_index }
    }

    pub(in crate::gpu) fn len(&self) -> usize {
        self.still.reach.len() + self.moving.reach.len()
    }

    /// Gaussians in the first layer, the first two, and so on.
    pub(in crate::gpu) fn layer_ends(&self) -> impl Iterator<Item = usize> {
        self.layers.iter().map(|end| end.still + end.moving)
    }

    /// Replaces `items` by the rows that, by `settings`, are to be drawn at clip time `t` in one of
    /// `views`, still rows first, rows rising within a region's ranges.
    pub(in crate::gpu) fn alive(
        &self,
        t: f64,
        views: &[View],
        settings: &Settings,
        items: &mut Vec<Item>,
    ) -> Seen {
        items.clear();
        let mut seen = Seen::default();
        let layers = settings.layers.map_or(self.layers.len(), |layers| layers.min(self.layers.len()));
        let Some(end) = layers.checked_sub(1).map(|last| self.layers[last]) else {
            return seen;
        };
        let middle = MiddleEye::of(views);
        let mut eyes = [Eye::NONE; EYES_MAX];
        for (eye, view) in eyes.iter_mut().zip(views) {
            *eye = Eye::new(view);
        }
        let eyes = &eyes[..views.len().min(EYES_MAX)];
        let mut visit = |region: &Region, row: usize, first: usize| {
            let opacity = region.field.opacity_at(row, t);
            if opacity < ALPHA_MIN {
                return;
            }
            seen.alive += 1;
            let center = DVec3::from_array(region.field.position_at(row, t));
            if !eyes.iter().any(|eye| eye.can_see(eye.place(center), region.reach[row])) {
                return;
            }
            let weight = |eye: &Eye| eye.weight_px(eye.place(center), opacity as f32, region.sigmas[row]);
            if settings.least_px > 0.0 && eyes.iter().all(|eye| weight(eye) < settings.least_px) {
                seen.faint += 1;
                return;
            }
            let from_eye = center - middle.position;
            let depth = match settings.sort {
                SortOrder::Depth => from_eye.dot(middle.forward),
                SortOrder::Radial => from_eye.length(),
            };
            items.push(Item::new(depth as f32, (first + row) as u32));
        };
        (0..end.still).for_each(|row| visit(&self.still, row, 0));
        let first = self.still.reach.len();
        let candidates = self.time_index.candidates(t, layers).flatten();
        candidates.for_each(|row| visit(&self.moving, row, first));
        seen
    }
}

/// Most eyes that one frame has.
pub(in crate::gpu) const EYES_MAX: usize = 2;

/// A view in the form that a quick test needs.
#[derive(Clone, Copy)]
struct Eye {
    view: View,
    /// Pixels that a unit of length at distance 1 covers at most.
    magnification: Vec2,
}

impl Eye {
    const NONE: Eye = Eye {
        view: View {
            view_from_world: DMat4::IDENTITY,
            focal: Vec2::ONE,
            principal: Vec2::ZERO,
            size: glam::UVec2::ONE,
        },
        magnification: Vec2::ZERO,
    };

    fn new(view: &View) -> Eye {
        let (low, high) = slope_limits(view);
        let slope = low.abs().max(high.abs());
        Eye { view: *view, magnification: view.focal * (1.0 + slope * slope).powf(0.5) }
    }

    /// Where a point of the world is from the eye.
    fn place(&self, center: DVec3) -> Vec3 {
        self.view.view_from_world.transform_point3(center).as_vec3()
    }

    /// Whether a Gaussian at `p` from the eye can leave a trace in the image. Never wrong when it
    /// says no.
    fn can_see(&self, p: Vec3, reach: f32) -> bool {
        // The radius to which blur alone, 0.3 px^2, can carry a Gaussian, plus a pixel for
        // rounding: sqrt(0.3 * 2 ln 255) + 1.
        const MARGIN: f32 = 2.9;
        let pixel = self.view.focal * p.truncate() / p.z + self.view.principal;
        // The footprint's deviation is sqrt(a^2 + b^2) of its own and the blur's: at most a + b.
        let reach = self.magnification * (reach / p.z) + MARGIN;
        p.z >= shaders::NEAR
            && (pixel + reach).cmpge(Vec2::ZERO).all()
            && (pixel - reach).cmple(self.view.size.as_vec2()).all()
    }

    /// The most that a Gaussian at `p` from the eye can add to the image, the sum of its alpha over
    /// all pixels, if it is turned to show its two longest axes, and as if it were in the middle.
    fn weight_px(&self, p: Vec3, opacity: f32, sigmas: Vec2) -> f32 {
        let footprint = sigmas * (self.view.focal.max_element() / p.length());
        let variances = footprint * footprint + shaders::BLUR;
        std::f32::consts::TAU * opacity * variances.element_product().sqrt()
    }
}

/// Range of x/z and y/z within which footprints are computed: the image and, on every side, 30 %
/// of half the field of view.
pub(in crate::gpu) fn slope_limits(view: &View) -> (Vec2, Vec2) {
    let size = view.size.as_vec2();
    let margin = 0.3 * 0.5 * size / view.focal;
    (-view.principal / view.focal - margin, (size - view.principal) / view.focal + margin)
}

#[cfg(test)]
mod tests;
