//! The reference renderer, on the CPU in f64: it defines what a clip looks like.
//!
//! It has one file per stage, named like the stages on the GPU: `alive` selects the Gaussians that are
//! alive at the instant, `evaluate` projects them, `sort` orders them by depth, and `splat` composites
//! them. Tests compare the GPU with it, pruning compares candidates by it, and tools draw with it where
//! there is no GPU.
//!
//! Conventions are those of gsplat, and so of nearly all fitted fields: variances get the filter of the field,
//! alpha is limited to 0.999 and skipped below 1/255, and a pixel is finished before its transmittance
//! falls to 1e-4.
//!
//! Its pictures decide the content of packages, so exponentials and logarithms come from `libm`, which
//! gives the same bits on all machines.

mod alive;
mod colors;
mod contribution;
mod coverage;
mod evaluate;
mod held;
mod sensitivity;
mod sh;
mod shown;
mod sort;
mod splat;

use codec::{Camera, Clip, Field};

pub(crate) use colors::Colors;
pub use contribution::{Contribution, contributions};
pub use coverage::{Coverage, Radius, coverage};
pub use held::render_held;
pub use sensitivity::sensitivities;
pub use shown::{Shown, shown};
pub use sort::Order;

use crate::image::Image;
use evaluate::Splat;

/// A scene to render: Gaussians that are sorted together, and an optional plate behind them.
#[derive(Clone, Debug)]
pub struct RenderScene<'a> {
    prefixes: Vec<FieldPrefix<'a>>,
    plate: Option<&'a Field>,
}

/// The first `rows` rows of a field.
#[derive(Clone, Copy, Debug)]
struct FieldPrefix<'a> {
    field: &'a Field,
    rows: usize,
}

impl<'a> RenderScene<'a> {
    /// The first `layers` decoded layers of a clip, clamped to 1 and the number of layers, and its plate.
    pub fn from_layers(clip: &'a Clip, layers: usize) -> RenderScene<'a> {
        let end = match clip.layers.get(layers.saturating_sub(1)).or(clip.layers.last()) {
            Some(end) => *end,
            None => return RenderScene { prefixes: Vec::new(), plate: clip.plate.as_ref() },
        };
        let prefixes = vec![
            FieldPrefix { field: &clip.static_field, rows: end.static_count },
            FieldPrefix { field: &clip.dynamic_field, rows: end.dynamic_count },
        ];
        RenderScene { prefixes, plate: clip.plate.as_ref() }
    }

    /// The same Gaussians in front of `plate`.
    pub fn with_plate(self, plate: &'a Field) -> RenderScene<'a> {
        RenderScene { plate: Some(plate), ..self }
    }
}

impl<'a> From<&'a Field> for RenderScene<'a> {
    fn from(field: &'a Field) -> RenderScene<'a> {
        RenderScene { prefixes: vec![FieldPrefix { field, rows: field.len() }], plate: None }
    }
}

impl<'a> From<&'a Clip> for RenderScene<'a> {
    fn from(clip: &'a Clip) -> RenderScene<'a> {
        RenderScene::from_layers(clip, clip.layers.len())
    }
}

/// Renders `scene` from `camera` at clip time `t` over black. `camera` must satisfy [`Camera::check`].
///
/// The picture does not depend on the number of threads. No pixel is NaN, even if numbers of the scene or
/// `t` are not finite.
pub fn render(scene: &RenderScene, camera: &Camera, t: f64, order: Order) -> Image {
    let mut splats = evaluate_all(&scene.prefixes, camera, t);
    sort::sort(&mut splats, order);
    if let Some(plate) = scene.plate {
        let mut behind = evaluate_all(&[FieldPrefix { field: plate, rows: plate.len() }], camera, t);
        sort::sort(&mut behind, order);
        splats.append(&mut behind);
    }
    splat::splat(&splats, camera.width, camera.height)
}

fn evaluate_all(prefixes: &[FieldPrefix], camera: &Camera, t: f64) -> Vec<Splat> {
    let mut splats = Vec::new();
    for prefix in prefixes {
        let alive = alive::alive(prefix.field, prefix.rows, t);
        splats.extend(evaluate::evaluate(prefix.field, &alive, camera, t));
    }
    splats
}

#[cfg(test)]
mod tests;
