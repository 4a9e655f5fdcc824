//! The reference renderer: what a clip looks like, by definition.
//!
//! In f64 and written to be read. One file per stage, with the names of the GPU's stages:
//! `alive` picks the Gaussians that are visible at the instant, `evaluate` moves and projects
//! them, `sort` orders them by depth, `splat` composites them. It is the oracle for the GPU and
//! the judge of pruning, and draws where there is no GPU.
//!
//! The conventions are those of gsplat and so of nearly every fitted field: covariances grow by
//! 0.3 px^2, a fragment's alpha is at most 0.999 and skipped below 1/255, a pixel is finished
//! once its transmittance would fall to 1e-4.
//!
//! Its pictures decide what a package holds, so exponentials and logarithms are those of `libm`, which
//! are the same on every machine; the system's are not.

mod alive;
mod colors;
mod contribution;
mod coverage;
mod evaluate;
mod held;
mod sensitivity;
mod sh;
mod sort;
mod splat;

use codec::{Camera, Clip, Field};

pub(crate) use colors::Colors;
pub use contribution::{Contribution, contributions};
pub use coverage::{Coverage, Radius, coverage};
pub use held::render_held;
pub use sensitivity::sensitivities;
pub use sort::Order;

use crate::image::Image;
use evaluate::Splat;

/// What to draw: Gaussians that are sorted together, and possibly a plate behind them.
#[derive(Clone, Debug)]
pub struct RenderScene<'a> {
    parts: Vec<FieldPrefix<'a>>,
    plate: Option<&'a Field>,
}

/// The first `rows` rows of a field.
#[derive(Clone, Copy, Debug)]
struct FieldPrefix<'a> {
    field: &'a Field,
    rows: usize,
}

impl<'a> RenderScene<'a> {
    /// The first `layers` decoded layers of a clip (all of them if there are fewer; at least one),
    /// and its plate.
    pub fn from_layers(clip: &'a Clip, layers: usize) -> RenderScene<'a> {
        let end = match clip.layers.get(layers.saturating_sub(1)).or(clip.layers.last()) {
            Some(end) => *end,
            None => return RenderScene { parts: Vec::new(), plate: clip.plate.as_ref() },
        };
        let parts = vec![
            FieldPrefix { field: &clip.static_field, rows: end.static_count },
            FieldPrefix { field: &clip.dynamic_field, rows: end.dynamic_count },
        ];
        RenderScene { parts, plate: clip.plate.as_ref() }
    }

    /// The same Gaussians with `plate` behind them.
    pub fn with_plate(self, plate: &'a Field) -> RenderScene<'a> {
        RenderScene { plate: Some(plate), ..self }
    }
}

impl<'a> From<&'a Field> for RenderScene<'a> {
    fn from(field: &'a Field) -> RenderScene<'a> {
        RenderScene { parts: vec![FieldPrefix { field, rows: field.len() }], plate: None }
    }
}

impl<'a> From<&'a Clip> for RenderScene<'a> {
    fn from(clip: &'a Clip) -> RenderScene<'a> {
        RenderScene::from_layers(clip, clip.layers.len())
    }
}

/// Renders `scene` from `camera` at clip time `t`, over black.
///
/// The picture does not depend on the number of threads. `camera` must satisfy
/// [`Camera::check`]; whatever the numbers of the scene and `t`, no pixel is NaN.
pub fn render(scene: &RenderScene, camera: &Camera, t: f64, order: Order) -> Image {
    let mut splats = evaluate_parts(&scene.parts, camera, t);
    sort::sort(&mut splats, order);
    if let Some(plate) = scene.plate {
        let mut behind = evaluate_parts(&[FieldPrefix { field: plate, rows: plate.len() }], camera, t);
        sort::sort(&mut behind, order);
        splats.append(&mut behind);
    }
    splat::splat(&splats, camera.width, camera.height)
}

fn evaluate_parts(parts: &[FieldPrefix], camera: &Camera, t: f64) -> Vec<Splat> {
    let mut splats = Vec::new();
    for part in parts {
        let alive = alive::alive(part.field, part.rows, t);
        splats.extend(evaluate::evaluate(part.field, &alive, camera, t));
    }
    splats
}

#[cfg(test)]
mod tests;
